"""The least margins over the box of a campaign's dispersions."""

import re

import numpy as np
import pytest

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.search import worst_margins
from abhv_mc.search.worst_margins import find_worst_margins
from abhv_mc.simulators.corner_margins import make_corners
from abhv_mc.simulators.margin_plans import trim_margins


@pytest.mark.parametrize("kind", ["dispersions", "unknowns"])
def test_a_hidden_corner_is_found_and_what_is_off_the_middle_is_named(repository, monkeypatch, tmp_path, kind):
    """Margins of a made-up loop: least where density is at its top and lift at 0.94, drag without effect."""
    text = (repository / "campaigns/s_manoeuvre.yaml").read_text().replace("../configs", str(repository / "configs"))
    if kind == "unknowns":
        text = text.replace("dispersions:", "unknowns:")
        text = re.sub(r"distribution: uniform, half_width: (\d+) %", r"low: -\1 %, high: \1 %", text)
    (tmp_path / "campaign.yaml").write_text(text)
    campaign = read_campaign(tmp_path / "campaign.yaml")
    assert bool(campaign.unknowns.names) == (kind == "unknowns")

    def margins(rows):
        density, lift = rows[:, PARAMETER_INDEX["atmosphere.density"]], rows[:, PARAMETER_INDEX["aero.lift"]]
        least = 10.0 - 20.0 * (density - 1.0) + 1000.0 * (lift - 0.94) ** 2
        return np.tile(least[:, None], 4), [""] * len(rows)

    monkeypatch.setattr(worst_margins, "trim_margins", lambda *_: {"tlc": margins})
    gain, *others = find_worst_margins(campaign, ("tlc",))
    assert len(others) == 3
    assert gain.nominal == pytest.approx(13.6)
    assert gain.found == pytest.approx(8.0, abs=1e-3)
    assert gain.parameters["atmosphere.density"] == pytest.approx(1.1)
    assert gain.parameters["aero.lift"] == pytest.approx(0.94, abs=1e-3)
    assert gain.moved[0] == "atmosphere.density" and "aero.lift" in gain.moved


@pytest.mark.thorough
def test_what_is_found_is_no_greater_than_at_any_corner(repository):
    campaign = read_campaign(repository / "campaigns/s_manoeuvre.yaml")
    (margins,) = trim_margins(campaign, ["tlc"]).values()
    corners, faults = margins(make_corners(campaign))
    assert not any(faults)
    found = find_worst_margins(campaign, ["tlc"])
    for k, one in enumerate(found):
        assert one.found <= corners[:, k].min() + 1e-6
        assert one.nominal == pytest.approx(corners[0, k], rel=1e-6)
