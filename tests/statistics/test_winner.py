"""Tests of the selection of a winner by pairs of flights.

It is named if there is one, and hardly ever if there is none.
"""

import numpy as np
import pytest
from scipy import integrate
from scipy.stats import binom

from abhv_mc.statistics.winner import (
    Decision,
    agree,
    compare_failures,
    compare_metric,
    decide,
    log_coin_evidence,
    median_ratio,
    pairing_gain,
    worse_tails,
)

NONE = np.zeros(1000, dtype=bool)
LOST = NONE[:300], NONE[:300]


def lose(values, lost):
    return np.where(lost, np.inf, values)


@pytest.mark.parametrize(("metrics", "pairs"), [(1, 1), (4, 1), (1, 20), (4, 20)])
def test_metrics_and_pairs_share_the_risk(metrics, pairs):
    worse = decide(
        np.where(np.arange(1000) < 50, 1.5, 0.5), np.ones(1000), NONE, NONE, metrics, pairs=pairs
    ).worse
    assert worse == pytest.approx(((0.05 / (metrics * pairs) / 4.0) ** 1e-3,))
    counts = range(150, 301, 3)
    values = (np.where(np.arange(300) < count, 0.0, 2.0) for count in counts)
    wins = [decide(a, np.ones(300), *LOST, metrics, pairs=pairs).closer for a in values]
    least = np.log(2.0 * metrics * pairs / 0.05)
    assert [*map(bool, wins)] == [log_coin_evidence(k, 300 - k) >= least for k in counts]


def test_early_terminations_are_a_family_of_their_own():
    lost = np.arange(300) < 8
    p_value = compare_failures(lost, LOST[0]).p_value  # 0.0078
    better = np.zeros(300), np.ones(300)
    blocked = [decide(*better, lost, LOST[0], 50, pairs=n).loses_more for n in (1, 6, 36)]
    assert blocked == [p_value <= 0.05 / n for n in (1, 6, 36)] == [True, True, False]
    assert binom.sf(5, 300, 0.03) >= 0.8  # 6 flights of one controller only are significant


@pytest.mark.parametrize("swapped", [False, True])
def test_the_closer_one_wins(swapped):
    draw = np.random.default_rng(63)
    common = draw.normal(10.0, 3.0, 1000)
    a, b = common, common + 0.5 + draw.normal(0.0, 0.1, 1000)
    decision = decide(b, a, NONE, NONE, 9) if swapped else decide(a, b, NONE, NONE, 9)
    assert decision.closer == decision.winner == ("b" if swapped else "a")
    assert decision.uncompared == (0.9973,)  # 1000 flights say nothing about it
    assert decision.worse == () and not decision.loses_more


def test_who_loses_two_hundred_flights_more_does_not_win():
    """Was 'better', its flights that got through being closer."""
    draw = np.random.default_rng(64)
    lost = np.arange(1000) < 200
    a, b = draw.normal(1.0, 0.1, 1000), draw.normal(2.0, 0.1, 1000)
    decision = decide(lose(a, lost), b, lost, NONE, 9)
    assert (decision.closer, decision.winner, decision.loses_more) == ("a", "", True)
    assert 0.95 in decision.worse
    mirrored = decide(b, lose(a, lost), NONE, lost, 9)
    assert (mirrored.closer, mirrored.winner) == ("b", "")
    # Nor where the metric does not see that the flights were lost.
    blind = decide(a, b, np.arange(1000) < 20, NONE, 9)
    assert (blind.closer, blind.winner, blind.worse, blind.loses_more) == ("a", "", (), True)


@pytest.mark.parametrize("size", [1000, 5000])
def test_who_is_many_times_worse_in_two_per_cent_does_not_win(size):
    """Was 'better': 6.7 times worse in 2 % of the flights is no matter of the median."""
    draw = np.random.default_rng(65)
    b = draw.normal(1.0, 0.1, size)
    a = np.where(np.arange(size) < 0.02 * size, 6.7 * b, 0.9 * b)
    decision = decide(a, b, np.zeros(size, dtype=bool), np.zeros(size, dtype=bool), 9)
    assert (decision.closer, decision.winner) == ("a", "")
    assert all(level > 0.98 for level in decision.worse) and decision.worse


def test_ties_are_left_out():
    a, b = np.zeros(100), np.zeros(100)
    a[:10] = -1.0
    assert decide(a, b, NONE[:100], NONE[:100], 1).closer == "a"  # on all ten that differ
    a[10:15] = 1.0
    assert decide(a, b, NONE[:100], NONE[:100], 1).closer == ""


@pytest.mark.parametrize(("heads", "tails"), [(10, 0), (7, 3), (600, 400), (3, 9)])
def test_evidence_of_a_coin_is_the_integral(heads, tails):
    ratio, _ = integrate.quad(
        lambda p: 2.0 * (2.0 * p) ** heads * (2.0 * (1.0 - p)) ** tails, 0.5, 1.0, limit=200
    )
    assert log_coin_evidence(heads, tails) == pytest.approx(np.log(ratio), rel=1e-6)


def test_a_failed_flight_loses():
    comparison = compare_metric(
        np.array([np.inf, 1.0, np.inf, 3.0, 5.0]), np.array([5.0, 2.0, np.inf, 3.0, 4.0])
    )
    assert (comparison.a_better, comparison.b_better, comparison.ties) == (1, 2, 2)
    assert comparison.median_difference.value == 0.0
    assert comparison.pairing_gain == pytest.approx((8 / 3 + 2 / 3) / (2 / 3))  # variances


def test_pairs_that_are_equal_or_too_few_have_no_pairing_gain():
    a = np.array([1.0, 5.0, 2.0, np.inf])
    assert pairing_gain(a, a) is pairing_gain(a[1:], a[::-1][1:]) is None


def test_points_agree_on_one_side_and_collect_what_speaks_against_it():
    first, second = Decision("a", (0.95,), (0.9973,)), Decision("a", (0.9,), (), loses_more=True)
    assert agree([first, second]) == Decision("a", (0.9, 0.95), (0.9973,), loses_more=True)
    assert agree([first, Decision("b")]) == agree([first, Decision("")]) == Decision("")


def test_ratios_are_of_finite_positive_pairs():
    a, b = np.array([2.0, 3.0, 8.0, np.inf, 0.0, 5.0]), np.array([1.0, 1.0, 2.0, 1.0, 1.0, -1.0])
    assert median_ratio(a, b).value == 3.0 and median_ratio(a[1:], b[1:]) is None


def test_failures_are_cross_counted():
    a, b = np.repeat([[1, 1, 0, 0], [1, 0, 1, 0]], [2, 3, 4, 5], axis=1).astype(bool)
    comparison = compare_failures(a, b)
    counts = comparison.both, comparison.only_a, comparison.only_b, comparison.neither
    assert counts == (2, 3, 4, 5) and comparison.p_value == 1.0
    assert compare_failures(a, np.zeros(14, bool)).p_value == 0.0625  # 5 of 5: 2 / 32


def test_quantiles_that_few_flights_do_not_bound_are_not_compared():
    """The outermost quantile that 20 flights bound replaces both."""
    a, b = np.random.default_rng(1).normal(size=(2, 1000))
    assert worse_tails(a, b, 0.95) == ((), (0.9973,))
    outermost = ((0.05 / 4.0) ** 1e-3, (0.05 / 4.0) ** 0.05)
    assert worse_tails(a, a - 5.0, 0.95) == ((0.95, pytest.approx(outermost[0])), (0.9973,))
    for rise, worse in ((0.0, ()), (9.0, (pytest.approx(outermost[1]),)), (-9.0, ())):
        assert worse_tails(a[:20] + rise, b[:20], 0.95) == (worse, (0.95, 0.9973))
