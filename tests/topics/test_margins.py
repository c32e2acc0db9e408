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
    FlightMargins,
    LeastMargins,
    Spread,
    compute_margins,
    corners_unstable,
    least_margins,
    margin_section,
    missing_margins,
)
from abhv_mc.topics.margins.figures import draw, plot_margins
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
    _, together, least = margin_section(found, names).tables()
    (cells,) = together.plain_rows()
    assert cells[:5] == ["TLC", "5.5 / 0.0", "11 / 0", "16 / 0", "22.00 / 0.00"]
    assert cells[5:7] == ["2 of 6", "3 of 6"]
    assert "1 of 3 (33\u202f%) below" in cells[7] and "2 of 3 (67\u202f%) at" in cells[7]
    listed = ((4, 0.0, "yes"), (5, 0.0, "no"), (0, 5.0, "no"), (3, 6.0, "yes"), (1, 7.0, "yes"))
    assert [row[:7] for row in least.plain_rows()] == [
        ["TLC", f"{k}", f"{x:.1f}", f"{2 * x:.0f}", f"{3 * x:.0f}", f"{4 * x:.2f}", failed]
        for k, x, failed in listed
    ]
    assert all(f"--flight {row[1]} --controller tlc" in row[7] for row in least.plain_rows())
    assert [flight.faults[MARGIN_FAULTS[0].name] for flight in own.least] == [2, 2, 0, 0, 0]
    assert found.points == ("trim", 2.0)
    assert len(missing_margins(found, names)) == len(missing)
    beyond = np.array([0.1, 0.8, 0.0, 0.5, np.inf, 0.2, 0.0, -0.4])
    ranking = SimpleNamespace(beyond={"tlc": beyond})
    drawn = SimpleNamespace(flights=results.flights, ranking=ranking)
    gains, phases = plot_margins(found, replace(names, results=drawn), "y").axes
    passed, failed = (points.get_offsets().tolist() for points in gains.collections)
    assert passed == [[5.0, 10.0], [0.0, 20.0], [12.0, -40.0]]
    assert failed == [[7.0, 80.0], [6.0, 50.0], [0.0, pytest.approx(80.0 + 0.15 * 120.0)]]
    assert phases.collections[0].get_offsets()[0].tolist() == [10.0, 10.0]
    free = replace(names, requirements=(), results=drawn)
    for names_drawn, word in ((replace(names, results=drawn), "limit"), (free, "median")):
        ((text, figure),) = draw(found, names_drawn)
        assert figure.axes[0].get_ylabel() == f"exceedance (% of {word})"
        assert [line.get_label() for line in figure.axes[0].lines] == [word]
        assert word in text.caption and ("failures" in text.caption) is (word == "limit")
    assert len(figure.axes[0].collections[1].get_offsets()) == 1  # the early termination
    campaign = replace(campaign, requirements=())
    without = compute_margins(replace(results, campaign=campaign)).flights["tlc"]
    assert (without.failed_below, without.failed_above) == (None, None)
    monkeypatch.setattr(Experiment, "margin_flights", 0)
    none = compute_margins(results)
    assert (none.flights, none.missing, none.points) == ({}, {}, ())
    assert list(draw(none, names)) == [] and len(margin_section(none, names).tables()) == 1
    metrics[MARGIN_NAMES[0]] = np.full(8, np.nan)
    monkeypatch.setattr(Experiment, "margin_flights", 8)
    assert compute_margins(results).flights == {}


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


def test_every_margin_has_its_cell(models):
    """Values are nominal, then the smallest of the corners; LQR is unstable."""
    minus, both = "\N{MINUS SIGN}", "\N{PLUS-MINUS SIGN}"
    loops = ("aileron", "rudder", "elevator", "throttle")
    together = ["all at once", f"{both}4.4", f"{both}4.4", f"{both}28", f"{both}28", "40", "40"]
    corner = f"{minus}9.0 / 0.7"
    expected = [
        [
            "TLC",
            loop,
            f"{minus}20.0 / {0.8 if loop == 'rudder' else 12.0}",
            corner,
            "40",
            "33",
            "50",
            "44",
        ]
        for loop in loops
    ]
    expected.append(["TLC", *together])
    expected += [
        ["LQR retuned", loop, "none / 12.0", corner, "50", "33", "60", "44"] for loop in loops
    ]
    left = ["LQR retuned", "left_elevon", "none / 3.0", "none / none", "20", "none", "30", "none"]
    expected += [left, ["LQR retuned", *together]]
    rows = models.section(MARGINS).tables()[0].plain_rows()
    assert [row for row in rows if not row[0].startswith("LQR (")] == expected
    assert len(rows) == len(expected) + 1


def test_the_least_margin_is_of_the_loops_that_count(models):
    found = models[MARGINS]
    assert least_margins(found, "tlc") == LeastMargins(True, 0.82, "rudder", 40.0, "aileron")
    assert least_margins(found, "lqr") == LeastMargins(False)
    retuned = LeastMargins(True, 12.0, "aileron", 50.0, "aileron")
    assert least_margins(found, "lqr_retuned") == retuned
    assert least_margins(found, "unknown") is None
    counts = [corners_unstable(found, name) for name in ("tlc", "lqr", "unknown")]
    assert counts == [(0, 8), (8, 8), (0, 8)]
    entry = found.steady.controllers["tlc"]
    open_loops = [replace(row, phase_margin_deg=None) for row in entry.nominal]
    for changed, expected in (
        (replace(entry, fault="no trim"), None),
        (replace(entry, nominal=open_loops), LeastMargins(True, 0.82, "rudder", np.inf, "rudder")),
    ):
        steady = replace(found.steady, controllers={"tlc": changed})
        assert least_margins(replace(found, steady=steady), "tlc") == expected


@pytest.mark.parametrize(("count", "listed"), [(5, "1, 2, 3, 4, 5"), (6, "1, 2, 3, 4, 5, ...")])
def test_missing_margins_are_counted_and_a_few_are_listed(models, count, listed):
    found = replace(models[MARGINS], missing={"tlc": tuple(range(1, count + 1))})
    (clause,) = missing_margins(found, models.names)
    assert clause.endswith(f"TLC: {count} (flights {listed})")


def test_a_fault_is_of_all_loops_together(models):
    """The poles with a positive real part are printed."""
    found = models[MARGINS]
    *loops, together = found.steady.controllers["tlc"].nominal
    poles = [[0.5, 0.0], [-0.2, 1.0], [0.0, 0.0]]
    unstable = [*loops, replace(together, stable=False, poles=poles)]
    sound = [*(replace(row, stable=False) for row in loops), together]

    def first(**changes):
        entry = replace(found.steady.controllers["tlc"], **changes)
        steady = replace(found.steady, controllers={"tlc": entry})
        return (
            margin_section(replace(found, steady=steady), models.names).tables()[0].plain_rows()[0]
        )

    assert first(nominal=unstable)[0].endswith("(poles at +0.500 per second))")
    assert first(nominal=sound)[:2] == ["TLC", "aileron"]
    assert "no trim" in first(fault="no trim")[0]
    assert first(corners_unstable=3)[0].endswith("3 of 8)")


@pytest.mark.parametrize(
    ("below", "above", "text"),
    [(None, None, ""), ((0, 0), (1, 4), "1 of 4 (25"), ((2, 4), (0, 0), "2 of 4 (50")],
)
def test_failures_are_counted_where_there_are_flights(models, below, above, text):
    spreads = dict.fromkeys(MARGIN_NAMES, Spread(8.0, 4.0))
    own = FlightMargins(4, 0, 0, spreads, (), below, above)
    found = replace(models[MARGINS], flights={"tlc": own}, points=("trim",))
    (row,) = margin_section(found, models.names).tables()[1].plain_rows()
    assert row[7].startswith(text) and bool(row[7]) is bool(text) and row[7].count(" of ") <= 1
