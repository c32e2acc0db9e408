"""What a campaign can show, against counting and the verdicts themselves."""

import numpy as np
import pytest

from abhv_mc.statistics.flights_planned import (
    can_show,
    flights_for_failures,
    most_failures,
    pass_chance,
    sequential_curve,
    together,
)
from abhv_mc.statistics.sequential import choose_looks, make_sequential_plan
from abhv_mc.statistics.verdicts import judge


def test_flights_for_failures_are_published():
    # NASA/TP-2010-216447: 99.73 % at 10 %
    assert flights_for_failures(0.9973, 0.10) == {0: 852, 1: 1440, 2: 1970, 3: 2473}


def test_a_probability_that_no_outcome_shows():
    assert not can_show(400, 0.9999, 0.10)
    assert not can_show(851, 0.9973, 0.10) and can_show(852, 0.9973, 0.10)


@pytest.mark.parametrize("runs", [1, 400, 852, 1439, 1440, 5000])
def test_most_failures_are_those_of_the_verdict(runs):
    most = most_failures(runs, 0.9973, 0.10)
    assert most < 0 or judge(most, runs, 0.9973, 0.10).status == "PASS"
    assert judge(most + 1, runs, 0.9973, 0.10).status != "PASS"


def test_chance_of_pass_is_that_of_flown_campaigns():
    rates = np.array([0.0005, 0.0027, 0.01])
    draw = np.random.default_rng(81)
    counts = draw.binomial(1440, rates, (20_000, 3))
    assert pass_chance(1440, 0.9973, 0.10, rates) == pytest.approx(np.mean(counts <= 1, axis=0), abs=0.01)
    assert pass_chance(1440, 0.9973, 0.10, rates)[1] <= 0.10
    assert pass_chance(400, 0.9999, 0.10, rates).tolist() == [0.0, 0.0, 0.0]


def test_the_curve_with_stop_meets_the_risk_at_the_requirement():
    plan = make_sequential_plan(choose_looks(0.9973, 0.1, 5000), 0.9973, 0.1)
    rates = np.unique(np.append(np.geomspace(2.7e-5, 8.1e-3, 60), 1.0 - 0.9973))
    curve = sequential_curve(plan, rates)
    at = int(np.argmin(np.abs(rates - 0.0027)))
    assert curve.passed[at] == pytest.approx(plan.false_pass) and curve.failed[at] == pytest.approx(plan.false_fail)
    assert np.all(np.diff(curve.passed) <= 1e-12) and np.all(np.diff(curve.failed) >= -1e-12)
    assert curve.flights.max() <= 5000.0 and curve.flights[0] < 1300.0


def test_all_together_lies_between_the_bounds():
    one, other = np.array([0.9, 0.3]), np.array([0.8, 0.2])
    low, high = together([one, other])
    assert low == pytest.approx([0.7, 0.0]) and high == pytest.approx([0.8, 0.2])
    assert np.all(low <= one * other) and np.all(one * other <= high)
