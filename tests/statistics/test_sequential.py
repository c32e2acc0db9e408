"""Looking often must not make it easier to pass: 20,000 campaigns at the boundary."""

import numpy as np
import pytest

from abhv_mc.statistics import consumer_risk, judge, producer_risk, success_lower_bound
from abhv_mc.statistics.crossing import binomial_window
from abhv_mc.statistics.sequential import (
    SequentialVerdict,
    at_least_as_bad,
    at_least_as_good,
    choose_common_looks,
    choose_looks,
    make_sequential_plan,
    sequential_lower_bound,
    sequential_verdict,
    stopping_look,
)

CAMPAIGNS = 20_000
PROBABILITY, RISK = 0.9973, 0.10
LOOKS = choose_looks(PROBABILITY, RISK, 10_000)
PLAN = make_sequential_plan(LOOKS, PROBABILITY, RISK)


def failures_at_looks(success, seed):
    """Failures so far [campaign, look] of campaigns with a success probability."""
    draw = np.random.default_rng(seed)
    more = np.diff(LOOKS, prepend=0)
    return np.cumsum(draw.binomial(more, 1.0 - success, (CAMPAIGNS, len(LOOKS))), axis=1)


def share_that_pass(failures):
    """By the plan: first look that settles decides."""
    passed, failed = failures <= np.array(PLAN.accept), failures >= np.array(PLAN.reject)
    never = len(LOOKS)
    first_pass = np.where(passed.any(axis=1), passed.argmax(axis=1), never)
    first_fail = np.where(failed.any(axis=1), failed.argmax(axis=1), never)
    return np.mean(first_pass < first_fail), np.mean(first_fail < first_pass)


def test_false_verdicts_at_the_boundary_stay_within_the_risk():
    passed, failed = share_that_pass(failures_at_looks(PROBABILITY, 21))
    error = 3.0 * np.sqrt(RISK * (1.0 - RISK) / CAMPAIGNS)
    assert passed <= RISK + error
    assert failed <= RISK + error
    # ... and is what the exact sum says.
    assert passed == pytest.approx(PLAN.false_pass, abs=error)
    assert failed == pytest.approx(PLAN.false_fail, abs=error)
    assert 0.095 < PLAN.false_pass <= RISK
    assert 0.09 < PLAN.false_fail <= RISK


def test_naive_peeking_does_not():
    counts = failures_at_looks(PROBABILITY, 22)
    statuses = {
        (look, k): judge(int(k), look, PROBABILITY, RISK).status == "PASS"
        for i, look in enumerate(LOOKS)
        for k in np.unique(counts[:, i])
    }
    passed = [[statuses[look, k] for look, k in zip(LOOKS, row, strict=True)] for row in counts[:4000]]
    assert np.mean(np.any(passed, axis=1)) > 0.20


def test_good_and_bad_systems_are_settled():
    assert share_that_pass(failures_at_looks(0.9995, 23))[0] > 0.99
    assert share_that_pass(failures_at_looks(0.99, 24))[1] > 0.99


@pytest.mark.parametrize("success", [0.7, 0.5, 0.9])
def test_the_exact_chances_are_those_of_every_path(success):
    looks = (2, 4, 7, 10)
    plan = make_sequential_plan(looks, 0.7, 0.3)
    chances = {"PASS": 0.0, "FAIL": 0.0, "NOT SHOWN": 0.0}
    flights = 0.0
    for path in np.ndindex(*(2,) * looks[-1]):
        verdict = sequential_verdict(np.array(path, dtype=bool), plan)
        chance = np.prod([1.0 - success if step else success for step in path])
        chances[verdict.status] += chance
        flights += chance * verdict.flights
    found = plan.crossing(success)
    assert found.passed.sum() == pytest.approx(chances["PASS"], abs=1e-12)
    assert found.failed.sum() == pytest.approx(chances["FAIL"], abs=1e-12)
    assert found.expected(looks) == pytest.approx(flights, abs=1e-12)
    if success == 0.7:
        assert (plan.false_pass, plan.false_fail) == pytest.approx((chances["PASS"], chances["FAIL"]), abs=1e-12)
        assert 0.0 < plan.false_pass <= 0.3 and 0.0 < plan.false_fail <= 0.3


def sprt(allowed, risk, miss):
    """Exact expected flights at a fifth of the allowed failure rate of Wald's test between the two, and its risks."""
    good = allowed / 5.0
    win, lose = np.log((1.0 - good) / (1.0 - allowed)), np.log(good / allowed)
    accept, reject = np.log((1.0 - miss) / risk), np.log(miss / (1.0 - risk))
    found = []
    for rate in (allowed, good):
        count = np.arange(120)
        inside = np.where(count == 0, 1.0, 0.0)
        flights = passed = 0.0
        n = 0
        while inside.sum() > 1e-9:
            flights, n = flights + inside.sum(), n + 1
            inside = inside * (1.0 - rate) + np.roll(inside, 1) * rate
            ratio = (n - count) * win + count * lose
            passed += inside[ratio >= accept].sum()
            inside[(ratio >= accept) | (ratio <= reject)] = 0.0
        found.append((flights, passed))
    return found[1][0], found[0][1], 1.0 - found[1][1]


@pytest.mark.parametrize(
    ("probability", "risk", "most"), [(0.9973, 0.10, 10_000), (0.99, 0.05, 20_000), (0.9, 0.10, 2_000)]
)
def test_a_good_system_flies_at_most_a_quarter_more_than_walds_test(probability, risk, most):
    plan = make_sequential_plan(choose_looks(probability, risk, most), probability, risk)
    found = plan.crossing(1.0 - (1.0 - probability) / 5.0)
    flights, _, miss = sprt(1.0 - probability, risk, risk)
    assert miss < risk + 0.01
    assert found.expected(plan.looks) <= 1.25 * flights
    assert found.passed.sum() > 0.99  # and misses fewer good systems


def test_the_usual_requirement_costs_a_good_system_under_1800_flights():
    """Pocock's bounds took 1995, Wald's test takes 1440."""
    for most in (5_000, 10_000, 1_000_000):
        plan = make_sequential_plan(choose_looks(PROBABILITY, RISK, most), PROBABILITY, RISK)
        assert plan.crossing(1.0 - (1.0 - PROBABILITY) / 5.0).expected(plan.looks) <= 1.25 * 1440


def test_a_system_near_the_requirement_passes_in_the_end():
    plan = make_sequential_plan(choose_looks(PROBABILITY, RISK, 1_000_000), PROBABILITY, RISK)
    assert plan.crossing(1.0 - 0.9 * (1.0 - PROBABILITY)).passed.sum() > 0.9


def test_plans_of_a_million_flights_are_small():
    """What the time goes into: few looks, and windows of counts that do not grow with the flights.

    A plan of 70,000 flights took a minute and more; one of a million now takes a third of a second.
    """
    looks = choose_looks(PROBABILITY, RISK, 1_000_000)
    assert len(looks) < 80
    start, window = binomial_window(1_000_000, 1.0 - PROBABILITY)
    assert start > 2000 and window.size < 1200
    assert window.sum() == pytest.approx(1.0, abs=1e-9)


def test_requirements_share_their_looks():
    demands = [(0.9973, 0.1), (0.95, 0.1)]
    looks = choose_common_looks(demands, 5_000)
    assert set(choose_looks(0.95, 0.1, 5_000)) <= set(looks) and looks[-1] == 5_000
    for probability, risk in demands:
        plan = make_sequential_plan(looks, probability, risk)
        assert plan.false_pass <= risk and plan.false_fail <= risk


def test_one_look_is_the_verdict_of_one_look():
    plan = make_sequential_plan((1440,), PROBABILITY, RISK)
    assert plan.accept == (1,)  # 1440 flights prove 99.73 % with one failure, NASA/TP-2010-216447
    assert make_sequential_plan((1439,), PROBABILITY, RISK).accept == (0,)


def test_the_verdict_is_that_of_the_first_settling_look():
    failed = np.zeros(20_000, dtype=bool)
    clean = sequential_verdict(failed, PLAN)
    first = next(look for look, accept in zip(LOOKS, PLAN.accept, strict=True) if accept >= 0)
    assert (clean.status, clean.flights, clean.failures) == ("PASS", first, 0)
    assert first > 852  # more than one look's worth: the price of looking
    failed[:30] = True
    assert sequential_verdict(failed, PLAN).status == "FAIL"
    early = sequential_verdict(failed[:100], PLAN)
    assert (early.status, early.flights) == ("NOT SHOWN", 0)


def test_flights_beyond_the_stopping_look_change_nothing():
    draw = np.random.default_rng(25)
    failed = draw.random(10_000) < 0.0005
    stop = stopping_look([failed, failed], [PLAN, PLAN])
    assert sequential_verdict(failed[:stop], PLAN) == sequential_verdict(failed, PLAN)
    assert stopping_look([failed[:100]], [PLAN]) is None


def test_looks_must_ascend():
    with pytest.raises(ValueError, match="ascend"):
        make_sequential_plan((100, 100), 0.9, 0.1)
    with pytest.raises(ValueError, match="between"):
        make_sequential_plan((100,), 1.0, 0.1)


def test_bounds_that_allow_for_the_looks_are_wrong_as_seldom_as_promised():
    success, looks = 0.92, (40, 80, 160)
    plan = make_sequential_plan(looks, 0.9, RISK)
    draw = np.random.default_rng(26)
    failed = draw.random((4000, looks[-1])) < 1.0 - success
    bounds = {}
    wrong = 0
    for flags in failed:
        verdict = sequential_verdict(flags, plan)
        if verdict not in bounds:
            bounds[verdict] = sequential_lower_bound(verdict, plan)
        wrong += bounds[verdict] > success
    assert wrong / 4000 <= RISK + 3.0 * np.sqrt(RISK * (1.0 - RISK) / 4000)
    assert wrong > 0
    assert all(bound >= 0.9 for verdict, bound in bounds.items() if verdict.status == "PASS")


def test_one_look_has_the_bound_and_risks_of_one_look():
    plan = make_sequential_plan((2000,), PROBABILITY, RISK)
    verdict = SequentialVerdict("NOT SHOWN", 2000, 3)
    assert sequential_lower_bound(verdict, plan) == pytest.approx(success_lower_bound(3, 2000, RISK), abs=1e-12)
    assert at_least_as_good(verdict, plan, PROBABILITY) == pytest.approx(consumer_risk(3, 2000, PROBABILITY))
    assert at_least_as_bad(verdict, plan, PROBABILITY) == pytest.approx(producer_risk(3, 2000, PROBABILITY))


def test_every_outcome_is_as_good_or_worse():
    """The chances of the outcomes, from the order's two tails, add up to one."""
    looks, success = (2, 4, 6), 0.7
    plan = make_sequential_plan(looks, success, 0.3)
    seen = {}
    for path in np.ndindex(*(2,) * 6):
        verdict = sequential_verdict(np.array(path, dtype=bool), plan)
        seen[verdict] = seen.get(verdict, 0.0) + np.prod([1.0 - success if step else success for step in path])
    for verdict, chance in seen.items():
        both = at_least_as_good(verdict, plan, success) + at_least_as_bad(verdict, plan, success)
        assert both - 1.0 == pytest.approx(chance, abs=1e-12)
