"""What verdicts are worth after extensions, and with flights that were not computed."""

import numpy as np
import pytest

from abhv_mc.statistics.looks import first_untried, judge_at_looks, judge_by_plan
from abhv_mc.statistics.sequential import choose_looks, make_sequential_plan
from abhv_mc.statistics.verdicts import judge, runs_needed

PROBABILITY, RISK = 0.9973, 0.10


def flags(size, *where):
    found = np.zeros(size, dtype=bool)
    found[list(where)] = True
    return found


def test_what_the_first_look_settled_stays_with_its_flights():
    missed = flags(5000, 2000, 2001, 2002, 2003, 2004, *range(3000, 3080))
    found = judge_at_looks(missed, flags(5000), (1000, 5000), PROBABILITY, RISK)
    assert (found.status, found.failures, found.runs) == ("PASS", 0, 1000)
    assert "first 1000 flights" in found.note
    failed = judge_at_looks(flags(5000, *range(10)), flags(5000), (1000, 5000), PROBABILITY, RISK)
    assert (failed.status, failed.runs) == ("FAIL", 1000)


def test_what_it_did_not_settle_is_an_estimate():
    """700 flights, a look, then 1440: the same '10 %' was printed."""
    found = judge_at_looks(flags(1440), flags(1440), (700, 1440), PROBABILITY, RISK)
    assert (found.status, found.failures, found.runs) == ("ESTIMATE", 0, 1440)
    assert found.lower_bound is found.consumer_risk is found.met is None
    assert "extended from 700 to 1440 flights" in found.note
    # In parts, and before a look at the last of them, too.
    assert judge_at_looks(flags(1440), flags(1440), (700,), PROBABILITY, RISK).status == "ESTIMATE"


def test_healing_is_no_extension():
    one = flags(852, 5)
    broken = judge_at_looks(flags(852), one, (852,), PROBABILITY, RISK)
    healed = judge_at_looks(flags(852), flags(852), (852, 852), PROBABILITY, RISK)
    assert (broken.status, broken.failures, broken.provisional) == ("NOT SHOWN", 1, True)
    assert (healed.status, healed.provisional) == ("PASS", False)


def test_no_look_no_verdict():
    found = judge_at_looks(flags(400), flags(400), (), 0.9, RISK)
    assert found.status == "ESTIMATE" and "not all that were planned" in found.note
    assert judge_at_looks(flags(400), flags(400), (1000,), 0.9, RISK).status == "ESTIMATE"
    with pytest.raises(ValueError, match="ascend"):
        judge_at_looks(flags(400), flags(400), (300, 200), 0.9, RISK)
    with pytest.raises(ValueError, match="judged"):
        judge_at_looks(flags(4), flags(5), (4,), 0.9, RISK)


def test_dependent_flights_stay_an_estimate():
    assert judge_at_looks(flags(400), flags(400), (200, 400), 0.9, RISK, independent=False).status == "ESTIMATE"


def follow_the_page(failed, most):
    """Looks of a user who adds the flights that are still needed without a failure, and whether the last passes."""
    totals = np.concatenate([[0], np.cumsum(failed)])
    looks = [700]
    while True:
        now, failures = looks[-1], int(totals[looks[-1]])
        status = judge(failures, now, PROBABILITY, RISK).status
        following = runs_needed(failures, PROBABILITY, RISK)
        if status != "NOT SHOWN" or following > most:
            return looks, status == "PASS"
        looks.append(following)


@pytest.mark.parametrize(("most", "without_looks"), [(5000, 0.18), (20_000, 0.31)])
def test_extending_until_it_passes_stays_within_the_risk(most, without_looks):
    """It passed a system that just misses the requirement in 24.9 % by 5000 flights and in 37.8 % by 20,000."""
    draw = np.random.default_rng(41)
    naive = honest = 0
    for _ in range(600):
        failed = draw.random(most) < 1.0 - PROBABILITY
        looks, passed = follow_the_page(failed, most)
        naive += passed
        honest += judge_at_looks(failed[: looks[-1]], flags(looks[-1]), looks, PROBABILITY, RISK).status == "PASS"
    assert naive > without_looks * 600
    assert honest <= RISK * 600


def test_a_first_look_that_can_pass_spends_the_risk_once():
    draw = np.random.default_rng(42)
    failed = draw.random((3000, 3000)) < 1.0 - PROBABILITY
    passed = [
        judge_at_looks(row, flags(3000), (1440, 2200, 3000), PROBABILITY, RISK).status == "PASS" for row in failed
    ]
    assert np.mean(passed) <= RISK + 3.0 * np.sqrt(RISK * (1.0 - RISK) / 3000)
    assert np.mean(passed) > 0.05


PLAN = make_sequential_plan(choose_looks(PROBABILITY, RISK, 5000), PROBABILITY, RISK)
FIRST = next(look for look, accept in zip(PLAN.looks, PLAN.accept, strict=True) if accept >= 0)


def test_fixed_and_sequential_count_uncomputed_flights_alike():
    """Each left them out in its own way."""
    uncomputed = flags(5000, *range(0, 5000, 7))
    fixed = judge_at_looks(flags(5000), uncomputed, (5000,), PROBABILITY, RISK)
    stopped = judge_by_plan(flags(5000), uncomputed, PLAN)
    assert fixed.status == stopped.status == "FAIL"
    assert fixed.provisional and stopped.provisional
    assert stopped.uncomputed == stopped.failures == int(uncomputed[: stopped.runs].sum())


def test_a_settling_look_that_ends_in_an_uncomputed_flight():
    """Manifest and report count the same flights: those up to the look, whatever is known of the last."""
    uncomputed = flags(5000, FIRST - 1)
    found = judge_by_plan(flags(5000), uncomputed, PLAN)
    assert found.runs > FIRST and found.failures == 1 and found.status == "PASS"
    short = judge_by_plan(flags(FIRST), uncomputed[:FIRST], PLAN)
    assert (short.status, short.runs, short.failures, short.provisional) == ("NOT SHOWN", FIRST, 1, True)


def test_no_look_settles_before_its_uncomputed_flights_were_tried_again():
    uncomputed = flags(5000, 3)
    waiting = judge_by_plan(flags(5000), uncomputed, PLAN, untried=uncomputed)
    assert (waiting.status, waiting.runs) == ("NOT SHOWN", 0)
    assert first_untried(uncomputed) == 3 and first_untried(flags(9)) == 9
    later = flags(5000, FIRST)
    assert judge_by_plan(flags(5000), later, PLAN, untried=later).status == "PASS"
