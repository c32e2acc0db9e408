"""Weighted estimates: equal weights change nothing, and intervals hold what they promise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import quantile
from abhv_mc.statistics.reweight import (
    effective_size,
    join_unseen,
    unseen_of_range,
    unseen_of_values,
    weighted_quantile,
    weighted_share,
)
from benchmarks import interval_coverage

LEVELS = (0.5, 0.95, 0.9973)


@given(
    arrays(float, st.integers(2, 60), elements=st.floats(-5, 5)),
    st.sampled_from(LEVELS),
    st.floats(0.1, 9.0),
)
def test_equal_weights_give_numpys_quantile(values, level, weight):
    interval = weighted_quantile(values, np.full(values.size, weight), level)
    assert interval.value == pytest.approx(np.quantile(values, level), rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("flights", [100, 300, 2500])
@pytest.mark.parametrize("level", [0.1, *LEVELS])
def test_equal_weights_give_the_order_statistics_of_exact_intervals(flights, level):
    values = np.random.default_rng(flights).normal(size=flights)
    exact, weights = quantile(values, level), np.full(flights, 2.5)
    interval = weighted_quantile(values, weights, level)
    assert (interval.low, interval.high) == (exact.low, exact.high)
    # Flights without weight count for nothing.
    more = np.append(values, [-9.0, 9.0]), np.append(weights, [0.0, 0.0])
    assert weighted_quantile(*more, level) == interval


def test_few_flights_have_the_bounds_that_order_statistics_have():
    for level, low, high in ((0.1, -np.inf, 2.0), (0.5, -np.inf, np.inf), (0.95, 3.0, np.inf)):
        interval = weighted_quantile(np.arange(5.0), np.ones(5), level)
        assert (interval.low, interval.high) == (low, high)
    assert weighted_quantile(np.array([3.0, 9.0]), np.array([1.0, 0.0]), 0.9).value == 3.0
    infinite = weighted_quantile(np.append(np.arange(99.0), np.inf), np.ones(100), 0.999)
    assert infinite.value == infinite.high == np.inf and infinite.low < 99.0


@pytest.mark.parametrize("count", [0, 7, 300])
def test_equal_weights_give_clopper_pearson(count):
    flags = np.arange(300) < count
    interval = weighted_share(flags, np.full(300, 2.5))
    assert (interval.low, interval.high) == pytest.approx(clopper_pearson(count, 300), abs=1e-12)


def test_integer_weights_are_repetitions():
    draw = np.random.default_rng(2)
    values, weights = draw.normal(size=300), draw.integers(0, 4, 300).astype(float)
    value = weighted_quantile(values, weights, 0.9).value
    assert value == pytest.approx(
        np.quantile(np.repeat(values, weights.astype(int)), 0.9), abs=0.05
    )
    for scale in (1.0, 1e-3, 0.0):
        assert effective_size(scale * np.array([1.0, 1.0, 0.0, 0.0])) == (2.0 if scale else 0.0)


def test_what_no_flight_reaches_widens_the_interval():
    values, weights = np.linspace(0.0, 1.0, 1000), np.ones(1000)
    narrow, wide = (
        weighted_quantile(values, weights, 0.95),
        weighted_quantile(values, weights, 0.95, unseen=0.01),
    )
    assert wide.high == pytest.approx(narrow.high + 0.01, abs=2e-3) and wide.low == narrow.low
    assert weighted_quantile(values, weights, 0.95, unseen=0.05).high == np.inf
    assert weighted_share(values > 2.0, weights, unseen=0.01).high == pytest.approx(
        clopper_pearson(0, 1000)[1] + 0.01, abs=1e-12
    )


def test_discrete_values_that_no_flight_had_are_unseen():
    """Were ignored: 'worth 300 flights', where the true share of failures was 30 %."""
    unseen = unseen_of_values(
        np.array([0.0, 1.0, 2.0]), np.array([0.5, 0.2, 0.3]), np.array([0.0, 1.0, 1.0])
    )
    assert unseen == pytest.approx((0.3, 0.3))
    assert join_unseen([unseen, (0.004, 0.0)]).joint == pytest.approx(0.3)
    assert join_unseen([]).single == 0.0
    # The flights represent three times their shares of 0.001 and 0.002.
    beyond = unseen_of_range((0.02, 0.005), (1.0, 2.0), 1000)
    assert beyond == pytest.approx((0.025, 0.017))
    joined = join_unseen([beyond, unseen, (0.6, 0.9)])
    assert (joined.single, joined.joint) == (0.6, 1.0)


def test_intervals_of_different_weights_have_effective_numbers_of_flights():
    weights = np.repeat([1.0, 3.0, 5.0], [50, 30, 20])
    flags, shares = np.isin(np.arange(100), np.arange(0, 80, 10)), weights / 240.0
    interval = weighted_share(flags, weights)
    share = interval.value
    assert share == pytest.approx(shares[flags].sum())
    number = share * (1.0 - share) / np.sum((shares * (flags - share)) ** 2)
    number = min(number, 240.0**2 / np.sum(weights**2))
    low = stats.beta.ppf(0.025, share * number, (1.0 - share) * number + 1.0)
    counted = np.append(shares[flags], 3.0 / 240.0)  # one more failure of the largest weight
    events = counted.sum() ** 2 / np.sum(counted**2)
    total = events / counted.sum()
    high = stats.beta.ppf(0.975, events, total - events + 1.0)
    assert (interval.low, interval.high) == pytest.approx((low, high))


@pytest.mark.parametrize(
    ("case", "widened"),
    [
        (
            ("sum", 5, 1.1, 1000, 0.02),
            True,
        ),  # were refused: each of ten tails lies a little beyond the flights
        # The truth lay above the upper end in 21 % (outside of a ball in 47 %).
        (("sum", 3, 1.2, 2000, 3.8e-3), False),
        (("one", 3, 1.2, 2000, 3.8e-3), False),
        (("radius", 3, 1.2, 2000, 3.8e-3), False),
    ],
)
def test_wider_normals_are_answered_and_covered(case, widened):
    answered, missed = interval_coverage.whatif(*case, campaigns=250, widened=widened)
    assert answered >= 0.7
    assert missed.max() <= 0.04
