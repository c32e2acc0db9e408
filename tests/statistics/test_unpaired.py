"""Unpaired differences: Newcombe's published intervals, and the ranks of the bootstrap."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.statistics.unpaired import quantile_difference, share_difference


# Newcombe 1998, table II, method 10: 56/70 less 48/80, 9/10 less 3/10, 10/10 less 0/20.
@pytest.mark.parametrize(
    ("counts_b", "counts_a", "low", "high"),
    [
        ((56, 70), (48, 80), 0.0524, 0.3339),
        ((9, 10), (3, 10), 0.1705, 0.8090),
        ((10, 10), (0, 20), 0.6791, 1.0),
        ((6, 7), (2, 7), 0.0582, 0.8062),
    ],
)
def test_published_intervals_of_differences_of_shares(counts_b, counts_a, low, high):
    interval = share_difference(*counts_a, *counts_b)
    assert interval.value == pytest.approx(counts_b[0] / counts_b[1] - counts_a[0] / counts_a[1])
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=6e-5)


@pytest.mark.parametrize("probability", [0.2, 0.95])
def test_the_interval_against_a_constant_has_beta_distributed_ranks(probability):
    values, rank = np.arange(1000.0), 1000 * probability
    ends = 1000.0 * stats.beta.ppf([0.05, 0.95], rank, 1001.0 - rank)
    interval = quantile_difference(np.zeros(100), values, probability, 0.9)
    assert (interval.low, interval.high) == pytest.approx(ends, abs=2.0)
    other = quantile_difference(values, np.zeros(100), probability, 0.9)
    assert (other.low, other.high) == pytest.approx(-ends[::-1], abs=2.0)


def test_no_interval_without_flights_beyond_the_quantile():
    values = np.arange(100.0)
    assert quantile_difference(values, values, 0.9973) is None
    assert quantile_difference(values, np.full(100, np.inf), 0.5) is None
    assert quantile_difference(values[:20], np.arange(1e4), 0.99) is None
    assert quantile_difference(values, values + 2.0, 0.5).value == 2.0
