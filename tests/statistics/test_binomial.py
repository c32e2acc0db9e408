"""Tests of the exact acceptance statistics.

They are compared with published values and with scipy's distributions.
"""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from abhv_mc.statistics import (
    clopper_pearson,
    consumer_risk,
    mcnemar_exact,
    quantile_upper_rank,
    runs_needed,
    success_lower_bound,
)
from abhv_mc.statistics.binomial import jeffreys, mcnemar_one_sided

PROBABILITIES = st.sampled_from([0.5, 0.9, 0.95, 0.99, 0.9973, 0.99865])


@pytest.mark.parametrize(
    ("compute", "expected"),
    # Hanson & Beard, NASA/TP-2010-216447, worked through in exact arithmetic; flights needed at a
    # risk of 10 %
    [
        (lambda: consumer_risk(0, 1000, 0.9973), 0.06696055432972337),
        (lambda: consumer_risk(0, 1000, 0.99865), 0.2590039229282369),
        (lambda: consumer_risk(2, 2000, 0.9973), 0.09445549106897905),
        (lambda: consumer_risk(3, 2000, 0.9973), 0.2129065477161615),
        (lambda: success_lower_bound(0, 1000, 0.10), 0.9977000638225533),
        (lambda: [runs_needed(k, 0.99, 0.10) for k in range(3)], [230, 388, 531]),
        (lambda: [runs_needed(k, 0.9973, 0.10) for k in range(3)], [852, 1440, 1970]),
        (lambda: [quantile_upper_rank(n, 0.9973, 0.90) for n in (1000, 2000)], [1000, 1998]),
        (
            lambda: [mcnemar_exact(*pair) for pair in ((3, 12), (0, 0), (5, 5))],
            [0.03515625, 1.0, 1.0],
        ),
    ],
)
def test_oracles(compute, expected):
    assert compute() == pytest.approx(expected, rel=1e-11)
    assert quantile_upper_rank(1000, 0.99865, 0.90) is None


@given(st.integers(0, 60), st.integers(0, 60))
def test_mcnemar_and_two_sided_intervals_are_scipys(b, c):
    both = binomtest(b, b + c, 0.5) if b + c else None
    assert mcnemar_exact(b, c) == pytest.approx(both.pvalue if both else 1.0, rel=1e-9)
    assert mcnemar_one_sided(b, c) == pytest.approx(binom.sf(c - 1, b + c, 0.5), rel=1e-9)
    interval = both.proportion_ci(0.95, method="exact") if both else (0.0, 1.0)
    assert clopper_pearson(b, b + c) == pytest.approx(tuple(interval), abs=1e-12)


@given(st.integers(0, 40), st.integers(1, 4000), PROBABILITIES)
def test_risks_are_binomial_tails(failures, runs, probability):
    failures = min(failures, runs)
    law = binom(runs, 1.0 - probability)
    assert consumer_risk(failures, runs, probability) == pytest.approx(
        law.cdf(failures), rel=1e-7, abs=1e-12
    )


@given(st.integers(0, 40), st.integers(1, 4000), st.sampled_from([0.01, 0.1, 0.5]))
def test_lower_bound_is_scipys_one_sided_interval(failures, runs, risk):
    failures = min(failures, runs)
    bound = success_lower_bound(failures, runs, risk)
    scipys = (
        binomtest(runs - failures, runs, 0.5, alternative="greater").proportion_ci(1.0 - risk).low
    )
    assert bound == pytest.approx(scipys, abs=1e-10)


@given(st.integers(0, 30), PROBABILITIES, st.sampled_from([0.05, 0.1, 0.3]))
def test_runs_needed_is_the_first_that_is_enough(failures, probability, risk):
    runs = runs_needed(failures, probability, risk)
    assert consumer_risk(failures, runs, probability) <= risk
    assert consumer_risk(failures, max(runs - 1, failures), probability) > risk


@given(st.integers(1, 3000), PROBABILITIES, st.sampled_from([0.6, 0.9, 0.975]))
def test_upper_rank_is_the_smallest_with_its_confidence(runs, probability, confidence):
    rank = quantile_upper_rank(runs, probability, confidence)
    covered = binom.cdf(np.arange(runs), runs, probability)  # of ranks 1..runs
    enough = np.flatnonzero(covered >= confidence)
    assert rank == (enough[0] + 1 if enough.size else None)


def test_jeffreys_intervals_are_those_of_the_table_of_brown_cai_and_dasgupta():
    """Statistical Science 16 (2001), table 5, of ten trials, to three digits."""
    published = {0: (0.0, 0.217), 1: (0.011, 0.381), 2: (0.044, 0.503), 5: (0.224, 0.776)}
    for failures, ends in published.items():
        assert jeffreys(failures, 10) == pytest.approx(ends, abs=6e-4)
    assert jeffreys(10, 10)[1] == 1.0


def test_intervals_of_one_flight_are_closed_forms():
    assert clopper_pearson(0, 1) == pytest.approx((0.0, 0.975))
    assert clopper_pearson(1, 1, 0.9) == pytest.approx((0.05, 1.0))
