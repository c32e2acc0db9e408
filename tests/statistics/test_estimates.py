import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.bounds import Bounds
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import (
    Criterion,
    Interval,
    failure_trace,
    looks,
    pair_differences,
    quantile,
    quantile_traces,
    quantiles,
    severity,
    sorted_quantile,
    spread,
    worst_first,
)


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60),
    st.sampled_from([0.0, 0.05, 0.5, 0.9973, 1.0]),
)
def test_sorted_quantile_is_numpys_linear(values, probability):
    ascending = np.sort(np.array(values))
    expected = np.quantile(ascending, probability, method="linear")
    assert sorted_quantile(ascending, probability) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_interval_is_the_published_order_statistics():
    # Conover, Practical Nonparametric Statistics: 16 values, median, ranks 4 and 13 give 97.9 %
    interval = quantile(np.arange(1.0, 17.0), 0.5)
    assert (interval.low, interval.high) == (4.0, 13.0)
    # The bounds of a high quantile are those of the low quantile of the negated values.
    values = np.arange(100.0)
    high, low = quantile(values, 0.9), quantile(-values, 0.1)
    assert (high.low, high.high) == (-low.high, -low.low) == (83.0, 95.0)
    for sense, expected in (("low", Interval(-2.0, -3.0, -1.0)), ("size", Interval(2.0, 1.0, 3.0))):
        assert Interval(2.0, 1.0, 3.0).in_sense(sense) == expected
    (none,) = quantiles(np.empty(0), (0.5,))
    assert np.isnan(none.value) and (none.low, none.high) == (-np.inf, np.inf)


def test_failed_flights_are_the_worst():
    values = np.array([3.0, 1.0, 2.0, 0.5])
    failed = np.array([False, True, False, False])
    assert severity(values, "high", failed).tolist() == [3.0, np.inf, 2.0, 0.5]
    assert severity(values, "low", failed).tolist() == [-3.0, np.inf, -2.0, -0.5]
    assert severity(np.array([-4.0, np.nan]), "size").tolist() == [4.0, np.inf]
    assert quantile(severity(values, "high", failed), 0.9).value == np.inf
    assert quantile(severity(values, "high", failed), 0.5).value == 2.5


def test_pairs_that_both_failed_are_ties():
    inf = np.inf
    interval = quantile(pair_differences(np.array([inf, inf, 1.0]), np.array([inf, 2.0, 1.0])), 0.5)
    assert interval.value == 0.0


def test_the_last_look_is_the_whole_campaign():
    values, counts = np.random.default_rng(12).normal(size=300), looks(300)
    steps = np.rint(20.0 * 15.0 ** (np.arange(12) / 11.0))
    assert counts == sorted({*map(int, steps), 75, 150}) and looks(20) == [20]
    trace = quantile_traces(values, counts)[1]
    assert trace[-1] == quantile(values, 0.95)
    assert trace[0].high == np.inf  # 20 flights do not bound the 95 % quantile
    first, last = failure_trace(np.isin(np.arange(100), [3, 19, 99]), [20, 100])
    assert (first.value, last.value) == (0.1, 0.03)
    assert (last.low, last.high) == clopper_pearson(3, 100)


def test_early_ends_come_first_and_equals_keep_their_order():
    lost_at = np.array([np.inf, 9.0, np.inf, 3.0, np.inf])
    assert worst_first(lost_at, np.array([0.5, np.inf, 0.7, np.inf, 0.5])).tolist() == [
        3,
        1,
        2,
        0,
        4,
    ]


def test_distances_are_in_units_of_the_limit_or_of_the_span_where_it_is_zero():
    values = np.linspace(-1.0, 3.0, 401)
    assert Criterion("m", "high", Bounds(high=-5.0)).scale(values) == (0.0, 5.0)
    assert Criterion("m", "high", Bounds(1.0, 2.0)).scale(values) == (0.0, 0.5)
    assert np.allclose(Criterion("m", "low", Bounds(low=0.0)).scale(values), (0.0, 0.9 * 4.0))
    assert np.allclose(
        Criterion("m", "low").scale(values), (-1.0, 1.0)
    )  # without limits: from the median, in its size
    assert Criterion("m", "high").scale(np.array([])) == (0.0, 1.0)


def test_a_criterion_says_how_far_a_flight_is_beyond_its_limit():
    values = np.array([1.0, -4.0, np.nan])
    assert Criterion("m", "high", Bounds(high=3.0)).excess(values).tolist() == [-2.0, -7.0, np.inf]
    assert Criterion("m", "low", Bounds(low=3.0)).excess(values).tolist() == [2.0, 7.0, np.inf]
    assert Criterion("m", "size").excess(values).tolist() == [1.0, 4.0, np.inf]
    assert Criterion("m", "high", Bounds(0.0, 2.0)).excess(values).tolist() == [-1.0, 4.0, np.inf]


def test_the_spread_is_of_the_middle_ninety_percent():
    assert spread(np.append(np.arange(101.0), np.inf)) == 90.0
    assert spread(np.zeros(3)) == 1.0


def test_few_flights_bound_no_quantile():
    low, median, high = quantiles(np.arange(5.0), (0.1, 0.5, 0.9))
    assert (median.value, median.low, median.high) == (2.0, -np.inf, np.inf)
    assert (low.low, high.high) == (-np.inf, np.inf)
