"""The table of margins in the documentation is what the program says today."""

import numpy as np
import pytest

import abhv_mc


def _shown(number, digits):
    return f"{number:.{digits}f}" if np.isfinite(number) else "none"


def _cell(row):
    gains = f"{_shown(row.gain_margin_low_db, 1)}/{_shown(row.gain_margin_high_db, 1)}"
    return f"{gains}, {_shown(row.phase_margin_deg, 0)}, {_shown(row.delay_margin_ms, 0)}"


@pytest.mark.parametrize(
    ("vehicle", "controller", "mission"),
    [("abhv", "lqr", "level"), ("ghame_x", "inversion", "level"), ("winged_cone", "tlc", "level_mach15")],
)
def test_rows_of_the_table_are_those_of_the_program(repository, vehicle, controller, mission):
    page = (repository / "docs" / "explanation" / "margins.md").read_text("utf-8")
    found = abhv_mc.margins(mission, vehicle, controller)
    cells = " | ".join(_cell(found.loc[loop]) for loop in found.index[:4])
    together = f"{found.disk_margin['all']:.3f}, {found.delay_margin_ms['all']:.1f}"
    assert f"| {vehicle} | {controller} | {cells} | {together} |" in page
