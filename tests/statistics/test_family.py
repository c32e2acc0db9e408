"""Nine verdicts on boundary systems: the chance of any false PASS stays within the family's risk."""

import numpy as np
import pytest

from abhv_mc.statistics.family import bonferroni, false_pass_bound, hold_family, holm
from abhv_mc.statistics.looks import judge_at_looks
from abhv_mc.statistics.sequential import choose_looks, make_sequential_plan
from abhv_mc.statistics.verdict_words import needed_words
from abhv_mc.statistics.verdicts import judge

PROBABILITY, RISK = 0.9, 0.10
CAMPAIGNS = 2000


def boundary_failures(flights, seed):
    """Failures [campaign, verdict] of nine systems that just miss their requirement."""
    return np.random.default_rng(seed).binomial(flights, 1.0 - PROBABILITY, (CAMPAIGNS, 9))


def test_nine_pairs_alone_pass_somewhere_in_half_of_the_campaigns():
    counts = boundary_failures(380, 71)
    alone = np.mean([any(judge(k, 380, PROBABILITY, RISK).status == "PASS" for k in row) for row in counts.tolist()])
    assert 0.45 < alone < 0.65  # 59 %
    assert alone <= false_pass_bound([RISK] * 9) == pytest.approx(0.9)
    assert false_pass_bound([RISK] * 20) == 1.0


def test_holm_keeps_the_familys_risk():
    """Nine pairs alone had some false PASS in 59 % of campaigns."""
    passed = 0
    for row in boundary_failures(380, 72).tolist():
        held = hold_family([judge(k, 380, PROBABILITY, RISK) for k in row], RISK)
        passed += any(verdict.status == "PASS" for verdict in held)
    error = 3.0 * np.sqrt(RISK * (1.0 - RISK) / CAMPAIGNS)
    assert 0.02 < passed / CAMPAIGNS <= RISK + error


def test_holm_passes_more_than_bonferroni():
    good = [judge(0, 200, PROBABILITY, RISK)] * 8
    last = judge(11, 200, PROBABILITY, RISK)
    assert RISK / 9 < last.consumer_risk <= RISK
    assert [verdict.status for verdict in hold_family([*good, last], RISK)] == ["PASS"] * 9
    dropped = hold_family([judge(20, 200, PROBABILITY, RISK)] * 8 + [last], RISK)[-1]
    assert dropped.status == "NOT SHOWN" and "PASS alone" in dropped.note


@pytest.mark.parametrize(("failures", "flights"), [(0, 30), (2, 60), (0, 20)])
def test_what_would_show_it_is_what_the_family_takes(failures, flights):
    """Of 30 flights without a failure, which were not enough among four, it said that 22 would do, or none more."""
    pair = judge(failures, flights, PROBABILITY, RISK)
    held = hold_family([pair] * 4, RISK)
    assert {verdict.status for verdict in held} == {"NOT SHOWN"}
    (needed,) = {verdict.flights_needed for verdict in held}
    assert f"campaign (another seed) of {needed} flights" in needed_words(held[0])
    for runs, status in ((needed, "PASS"), (needed - 1, "NOT SHOWN")):
        again = hold_family([judge(failures, runs, PROBABILITY, RISK)] * 4, RISK)
        assert {verdict.status for verdict in again} == {status}


def test_holm_is_the_published_procedure():
    # Holm 1979: sorted p-values against risk/m, risk/(m-1), ...; the first that fails stops all after it.
    assert holm([0.01, 0.04, 0.03, 0.005], 0.05) == [True, False, False, True]
    assert holm([0.04, 0.04], 0.05) == [False, False]
    assert holm([], 0.05) == []
    with pytest.raises(ValueError, match="risk"):
        holm([0.1], 0.0)


def test_fails_and_estimates_stay():
    none = np.zeros(700, dtype=bool)
    estimate = judge_at_looks(none, none, (300, 700), PROBABILITY, RISK, independent=False)
    failed = judge(100, 200, PROBABILITY, RISK)
    assert hold_family([estimate, failed], RISK) == [estimate, failed]


def test_sequential_families_share_the_risk():
    shares = bonferroni([0.10, 0.05, 0.001], 0.10)
    assert shares == pytest.approx([0.1 / 3, 0.1 / 3, 0.001])
    looks = choose_looks(PROBABILITY, min(shares), 2000)
    plans = [make_sequential_plan(looks, PROBABILITY, share) for share in shares]
    assert false_pass_bound([plan.false_pass for plan in plans]) <= 0.10
