"""Survival of flights by failure case."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import beta

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flights.metrics import MARGIN_FAULTS, MARGIN_NAMES
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.topics.failure_cases import (
    CaseMargins,
    compute_failure_cases,
    drawn_cases,
    failure_case_section,
)
from abhv_mc.topics.failure_cases.figures import draw
from abhv_mc.topics.topic import Models, names_of


def test_a_case_counts_its_losses_and_their_times_since_the_first_failure(flown, monkeypatch):
    """The mission ends at 60 s: the failures of flights 4 and 5 do not occur."""
    results = flown(200)
    stuck, loss, end, altitude, gain, unstable = (
        np.array(text.split(), float)
        for text in (
            "inf 10 20 10 60 70 10 20",
            "inf inf inf inf inf inf inf 18",
            "5 14 15 20 60 60 60 21",
            "1 1 1 1 1 1 90 1",
            "1 4 nan 8 2 2 9 2",
            "5 0 5 2 5 5 0 5",
        )
    )
    samples = {"failure.elevator.stuck_time": stuck, "failure.rudder.loss_time": loss}
    others = {item.metric: np.zeros(8) for item in results.campaign.requirements}
    metrics = {**others, "end_time_s": end, "altitude_error_max_m": altitude}
    metrics |= {MARGIN_NAMES[0]: gain, MARGIN_FAULTS[0].name: unstable}
    outcome = np.where(end < 60.0, Outcome.BANK_LIMIT, Outcome.OK)
    flights = replace(results.flights["tlc"], flight=np.arange(8), outcome=outcome, metrics=metrics)
    results = replace(results, samples=samples, flights={"tlc": flights})
    assert (
        drawn_cases(results)[1].tolist()
        == np.where(stuck < 60.0, np.fmin(stuck, loss), np.inf).tolist()
    )
    found = compute_failure_cases(results)
    assert [(case.case, case.flights) for case in found.cases] == [
        ("none", 3), ("elevator stuck", 4), ("elevator stuck + rudder loss", 1)]  # fmt: skip
    none, one, both = (case.controllers["tlc"] for case in found.cases)
    assert (none.lost, none.lost_before, none.median_time_to_loss_s) == (1, 0, None)
    assert (one.flights, one.lost, one.lost_before, one.median_time_to_loss_s) == (4, 3, 1, 7.0)
    assert both.median_time_to_loss_s == 3.0
    assert one.survived.value == 0.25
    bounds = beta.ppf(0.025, 1, 4), beta.ppf(0.975, 2, 3)  # Clopper and Pearson, 1 of 4
    assert (one.survived.low, one.survived.high) == pytest.approx(bounds)
    assert [verdict.missed for verdict in one.requirements.values()] == [4, 3, 3]
    assert {verdict.status for verdict in one.requirements.values()} == {"FAIL"}
    assert one.margins == CaseMargins(3, 1, 8.0)
    (table,) = failure_case_section(found, Models(results).names).tables()
    share = "25\u202f% (0.6\u202f% to 81\u202f%)"
    rows = table.plain_rows()
    assert rows[1][:6] == ["elevator stuck", "4", "TLC", share, "3", "7.0 s"]
    assert [row[:3] + row[4:6] for row in (rows[0], rows[2])] == [
        ["none", "3", "TLC", "1", ""],
        ["elevator stuck + rudder loss", "1", "TLC", "1", "3.0 s"],
    ]
    assert re.findall(r"by (\d), (\w+)|(\S+) dB|(\d of \d)", rows[1][6]) == [
        ("4", "FAIL", "", ""), ("3", "FAIL", "", ""), ("3", "FAIL", "", ""),
        ("", "", "8.0", ""), ("", "", "", "1 of 3")]  # fmt: skip
    assert (found.end_s, none.survived.value) == (60.0, pytest.approx(2 / 3))
    monkeypatch.setattr(Experiment, "judged", False)
    dependent = compute_failure_cases(results)
    own = dependent.cases[1].controllers["tlc"]
    assert own.survived.value == 0.25 and np.isnan([own.survived.low, own.survived.high]).all()
    assert {verdict.status for verdict in own.requirements.values()} == {"ESTIMATE"}
    (table,) = failure_case_section(dependent, Models(results).names).tables()
    assert table.plain_rows()[1][3] == "25\u202f%"  # without bounds
    lqr = replace(results.flights["tlc"], metrics={**others, "end_time_s": end})
    case = compute_failure_cases(replace(results, flights={"lqr": lqr})).cases[1]
    assert case.controllers["lqr"].margins is None  # not computed
    assert case.controllers["lqr"].requirements == {}  # which are TLC's
    none = {"atmosphere.density": np.ones(8)}
    nothing = compute_failure_cases(replace(results, samples=none))
    assert nothing.cases == () and failure_case_section(nothing, names_of(results)) is None
    ((_, figure),) = draw(found, names_of(results))  # worst histories make no band
    elevator, both = (axes.lines[0].get_xydata().T for axes in figure.axes)
    # Of the three flights that end after the failure, two are lost, 4 and 10 s later.
    shares = [np.interp(time, *elevator) for time in (3.0, 5.0, 12.0)]
    assert shares == pytest.approx([100.0, 200.0 / 3.0, 100.0 / 3.0])
    assert [np.interp(time, *both) for time in (2.5, 3.5)] == [100.0, 0.0]


def test_a_loss_at_its_failure_follows_it_by_no_time(flown):
    results = flown(200)
    metrics = {item.metric: np.zeros(4) for item in results.campaign.requirements}
    metrics["end_time_s"] = np.array([9.75, 10.0, 10.0, 10.5])
    outcome = np.full(4, Outcome.BANK_LIMIT)
    flights = replace(results.flights["tlc"], flight=np.arange(4), outcome=outcome, metrics=metrics)
    samples = {"failure.rudder.loss_time": np.full(4, 10.0)}
    results = replace(results, samples=samples, flights={"tlc": flights})
    (case,) = compute_failure_cases(results).cases
    found = case.controllers["tlc"]
    assert (found.lost, found.lost_before, found.median_time_to_loss_s) == (4, 1, 0.0)
    ((_, figure),) = draw(None, names_of(results))
    times, shares = figure.axes[0].lines[0].get_xydata().T
    assert shares == pytest.approx(np.where(times < 0.5, 100.0 / 3.0, 0.0))


AIRBORNE = np.arange(0.0, 60.5, 0.5)
ENDS = np.array([5.0, 7.0, 9.0, 11.0, 40.0])  # of flights after their failures


def drawn_with_histories(monkeypatch, keep):
    """Return the figures of flights 0 to 4 with a stuck elevator, and four with a lost rudder.

    Flight k is k m above the reference, plus 1 m for each second since its failure.
    """
    stuck = np.r_[10.0, 12.0, 14.0, 16.0, 1.0, np.full(5, np.inf), 10.0, np.inf]
    loss = np.r_[np.full(5, np.inf), 20.0, 20.0, 20.0, 20.0, 20.0, 15.0, np.inf]
    first = np.fmin(stuck, loss)

    def history(k, offset):
        since = AIRBORNE - first[k]
        flown = since <= ENDS[min(k, 4)]
        bank = 178.0 + k + offset
        channels = {
            "time": AIRBORNE,
            "altitude_m": 20000.0 + 3.0 * AIRBORNE + k + since + offset,
            "angle_of_attack_deg": np.full(AIRBORNE.size, 2.0 * k),
            "bank_deg": np.full(AIRBORNE.size, (bank + 180.0) % 360.0 - 180.0),
            **({} if k == 3 else {"sideslip_deg": AIRBORNE}),
        }
        return {name: values[flown] for name, values in channels.items()}

    stored = {
        "tlc": {k: history(k, 0.0) for k in (*range(9), 10)},
        "lqr": {k: history(k, 100.0) for k in range(5)},
    }
    monkeypatch.setattr(
        "abhv_mc.topics.failure_cases.figures.read_histories", lambda _, name: stored[name]
    )
    flights = SimpleNamespace(
        flight=np.arange(12), end_time=np.full(12, 60.0), failed=np.zeros(12, bool)
    )
    kept = SimpleNamespace(keep=SimpleNamespace(histories=SimpleNamespace(flights=keep)))
    results = SimpleNamespace(
        folder=None,
        controllers=("tlc", "lqr"),
        samples={"failure.elevator.stuck_time": stuck, "failure.rudder.loss_time": loss},
        reference={"time": AIRBORNE, "altitude_reference_m": 20000.0 + 3.0 * AIRBORNE},
        flights={"tlc": flights, "lqr": flights},
        campaign=SimpleNamespace(
            model=kept,
            periods={
                "altitude_m": 0.0,
                "angle_of_attack_deg": 0.0,
                "sideslip_deg": 0.0,
                "bank_deg": 360.0,
            },
        ),
    )
    names = SimpleNamespace(results=results, controllers={"tlc": "TLC", "lqr": "LQR"})
    return {text.name: figure for text, figure in draw(None, names)}


def test_bands_after_a_failure_are_of_the_flights_still_flying(monkeypatch):
    figures = drawn_with_histories(monkeypatch, ["all"])
    titles = [text.get_text() for axes in figures["failure_survival"].axes for text in axes.texts]
    assert [title.replace("\n", " ") for title in titles if len(title) > 1] == [
        "elevator stuck (flights: 5)",
        "rudder loss (flights: 5)",
        "elevator stuck + rudder loss (flights: 1)",
    ]
    axes = figures["failure_bands"].axes
    assert [own.texts[-1].get_text() for own in axes[:2]] == ["elevator stuck", "rudder loss"]
    assert [own.get_ylabel() for own in axes[::2]] == [
        "altitude error (m)", "angle of attack (deg)", "bank (deg)", "sideslip (deg)"]  # fmt: skip
    # Only the elevator has five histories, and one of these lacks the sideslip.
    assert [len(own.collections) for own in axes] == [2, 0, 2, 0, 2, 0, 0, 0]
    times, k = np.arange(-2.0, 20.0, 0.25), np.arange(5.0)[:, None]
    starts = np.array([-2.0, -2.0, -2.0, -2.0, -1.0])
    flown = np.where((times >= starts[:, None]) & (times <= ENDS[:, None]), k, np.nan)
    low, middle, high = (f(flown, axis=0) for f in (np.nanmin, np.nanmedian, np.nanmax))
    expected = [(axes[0], "TLC", 1.0, times), (axes[0], "LQR", 1.0, 100.0 + times)]
    expected += [(axes[2], label, 2.0, 0.0) for label in ("TLC", "LQR")]
    expected += [(axes[4], "TLC", 1.0, 178.0), (axes[4], "LQR", 1.0, -82.0)]
    for i, (own, label, scale, shift) in enumerate(expected):
        line, area = own.lines[i % 2], own.collections[i % 2].get_paths()[0].vertices
        assert line.get_label() == label
        assert line.get_xdata() == pytest.approx(times)
        assert line.get_ydata() == pytest.approx(scale * middle + shift)
        edges = {tuple(point) for point in np.round(area, 6)}
        for edge in (low, high):
            assert edges >= set(zip(times, np.round(scale * edge + shift, 6), strict=True))


@pytest.mark.parametrize("keep", [["worst 5"], [7, "failed"]])
def test_histories_of_selected_flights_make_no_bands(monkeypatch, keep):
    assert list(drawn_with_histories(monkeypatch, keep)) == ["failure_survival"]
