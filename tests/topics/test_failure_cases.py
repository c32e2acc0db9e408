"""Survival of flights by failure case."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

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


def test_a_case_counts_its_losses_and_their_times_since_the_first_failure(flown):
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
    assert table.plain_rows()[1][:6] == ["elevator stuck", "4", "TLC", share, "3", "7.0 s"]
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
