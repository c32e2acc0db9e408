"""Section on stability: unstable and weak loops, and margins of flights."""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from report.synthetic import write_campaign

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.report.numbers.summary import summarize
from abhv_mc.topics.margins import (
    MARGINS,
    LeastMargins,
    Spread,
    compute_margins,
    margin_section,
    missing_margins,
)
from abhv_mc.topics.margins.figures import plot_margins
from abhv_mc.topics.topic import Models, names_of

LOOPS = ("aileron", "rudder", "elevator", "equivalence_ratio")


COLUMNS = "gain_margin_low_db", "gain_margin_high_db", "phase_margin_deg", "delay_margin_ms"


def _row(loop, *values, stable=True):
    return {"loop": loop, "stable": stable, **dict(zip(COLUMNS, values, strict=True))}


def _all(stable=True, **fields):
    row = {
        "loop": "all",
        "stable": stable,
        "disk_margin": 0.5,
        "disk_gain_db": 4.4,
        "disk_phase_deg": 28.0,
    }
    return row | {"delay_margin_ms": 40.0} | fields


def _steady():
    """Return margins with a weak rudder loop of TLC, an unstable LQR, and a stable LQR retuned."""
    weak = [_row(loop, -20.0, 0.82 if loop == "rudder" else 12.0, 40.0, 50.0) for loop in LOOPS]
    sound = [_row(loop, None, 12.0, 50.0, 60.0) for loop in LOOPS]
    sound.append(_row("left_elevon", None, 3.0, 20.0, 30.0) | {"counts": False})
    lost = [_row(loop, None, None, None, None, stable=False) for loop in LOOPS]
    corners = [_row(loop, -9.0, 0.7, 33.0, 44.0) for loop in LOOPS]
    entry = {"corners_without_trim": 0, "corners_unstable": 0, "corners": [*corners, _all()]}
    poles = [[0.12, 2.78], [0.0, 0.0]]
    return {
        "corners": 8,
        "all_corners": True,
        "controllers": {
            "tlc": {"nominal": [*weak, _all()], **entry},
            "lqr": {
                "nominal": [*lost, _all(stable=False, poles=poles)],
                **entry,
                "corners": [],
                "corners_unstable": 8,
            },
            "lqr_retuned": {"nominal": [*sound, _all()], **entry},
        },
    }


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    folder = write_campaign(tmp_path_factory.mktemp("stability") / "campaign", runs=40)
    (folder / "margins.json").write_text(json.dumps(_steady()), "utf-8")
    return Models(read_flown(folder))


def test_the_summary_names_the_unstable_controller_and_the_weak_one(models):
    records = {record.label: record for record in summarize(models).records}
    lines = [entry.line for entry in records["Margins"].entries]
    assert lines[0] == "LQR: unstable" and lines[1].startswith("TLC: 0.8 dB (rudder)")
    assert len(lines) == 2  # not LQR retuned, with 12 dB
    rows = models.section(MARGINS).tables()[0].plain_rows()
    (row,) = [row for row in rows if row[0].startswith("LQR (")]
    assert re.search(r"unstable\b.*\(.* \+0\.120 \N{PLUS-MINUS SIGN} 2\.78j\b", row[0])


def test_the_section_has_each_loop(models):
    rows = models.section(MARGINS).tables()[0].plain_rows()
    assert [
        "TLC",
        "rudder",
        "\N{MINUS SIGN}20.0 / 0.8",
        "\N{MINUS SIGN}9.0 / 0.7",
        "40",
        "33",
        "50",
        "44",
    ] in rows
    assert any(row[1:3] == ["left_elevon", "none / 3.0"] for row in rows)
    assert any(row[0].startswith("LQR (unstable") for row in rows)
    assert [row[0] for row in rows if row[1] == "throttle"] == ["TLC", "LQR retuned"]


@pytest.mark.parametrize(("requested", "missing"), [(8, {"tlc": (2,)}), (2, {})])
def test_margins_of_flights_are_counted_on_both_sides_of_the_customary_one(
    models, monkeypatch, requested, missing
):
    """Flights 1, 3 and 4 fail; 2 has no margins, and 6 has none because its law crashed."""
    gain = np.array([5.0, 7.0, np.nan, 6.0, 0.0, 0.0, np.nan, 12.0])
    metrics = {item.metric: np.zeros(8) for item in models.results.campaign.requirements}
    metrics["altitude_error_max_m"] = np.where(np.isin(np.arange(8), (1, 3)), 90.0, 0.0)
    metrics |= {name: (k + 1.0) * gain for k, name in enumerate(MARGIN_NAMES)}
    metrics |= {MARGIN_FAULTS[0].name: 2 * (gain < 1.0), MARGIN_FAULTS[1].name: 1 * (gain < 6.0)}
    outcome = np.zeros(8, int)
    outcome[[4, 6]] = Outcome.BANK_LIMIT, Outcome.LAW_CRASHED
    flights = replace(
        models.results.flights["tlc"], flight=np.arange(8), outcome=outcome, metrics=metrics
    )
    monkeypatch.setattr(Experiment, "margin_flights", requested)
    margins = SimpleNamespace(at=("trim", 2.0))
    model = models.results.campaign.model.model_copy(update={"margins": margins})
    campaign = replace(models.results.campaign, model=model)
    results = replace(models.results, campaign=campaign, flights={"tlc": flights})
    found = compute_margins(results)
    assert found.missing == missing
    own = found.flights["tlc"]
    assert (own.flights, own.unstable, own.at_limit) == (6, 2, 3)
    assert (own.failed_below, own.failed_above) == ((1, 3), (2, 3))
    assert own.margins[MARGIN_NAMES[1]] == Spread(11.0, 0.0)
    assert [flight.flight for flight in own.least] == [4, 5, 0, 3, 1]
    assert [flight.failed for flight in own.least] == [True, False, False, True, True]
    names = names_of(results)
    cells = margin_section(found, names).tables()[1].plain_rows()[0]
    assert cells[1:3] == ["5.5 / 0.0", "11 / 0"] and cells[5:7] == ["2 of 6", "3 of 6"]
    assert "1 of 3 (33\u202f%) below" in cells[7] and "2 of 3 (67\u202f%) at" in cells[7]
    assert len(missing_margins(found, names)) == len(missing)
    beyond = np.array([0.1, 0.8, 0.0, 0.5, np.inf, 0.2, 0.0, -0.4])
    ranking = SimpleNamespace(beyond={"tlc": beyond})
    drawn = SimpleNamespace(flights=results.flights, ranking=ranking)
    gains, phases = plot_margins(found, replace(names, results=drawn), "y").axes
    passed, failed = (points.get_offsets().tolist() for points in gains.collections)
    assert passed == [[5.0, 10.0], [0.0, 20.0], [12.0, -40.0]]
    assert failed == [[7.0, 80.0], [6.0, 50.0], [0.0, pytest.approx(80.0 + 0.15 * 120.0)]]
    assert phases.collections[0].get_offsets()[0].tolist() == [10.0, 10.0]


@pytest.mark.parametrize(
    ("gain", "phase", "words", "little"),
    [
        (14.3, np.inf, ("14.3 dB (rudder)", ""), False),
        (np.inf, 63.0, ("", "63 deg (elevator)"), False),
        (6.0, 30.0, ("6.0 dB (rudder)", "30 deg (elevator)"), False),
        (5.9, 63.0, ("5.9 dB (rudder)", "63 deg (elevator)"), True),
        (14.3, 29.9, ("14.3 dB (rudder)", "30 deg (elevator)"), True),
    ],
)
def test_margins_are_printed_if_finite_and_compared_with_the_customary_ones(
    gain, phase, words, little
):
    least = LeastMargins(True, gain, "rudder", phase, "elevator")
    assert (least.words, least.little) == (words, little)
