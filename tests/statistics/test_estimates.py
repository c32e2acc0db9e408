import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.statistics.estimates import (
    failure_trace,
    looks,
    pair_differences,
    quantile,
    quantile_traces,
    severity,
    sorted_quantile,
)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=60), st.sampled_from([0.0, 0.05, 0.5, 0.9973, 1.0]))
def test_sorted_quantile_is_numpys_linear(values, probability):
    ascending = np.sort(np.array(values))
    expected = np.quantile(ascending, probability, method="linear")
    assert sorted_quantile(ascending, probability) == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_interval_is_the_published_order_statistics():
    # Conover, Practical Nonparametric Statistics: 16 values, median, ranks 4 and 13 give 97.9 %
    found = quantile(np.arange(1.0, 17.0), 0.5)
    assert (found.low, found.high) == (4.0, 13.0)


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
    found = quantile(pair_differences(np.array([inf, inf, 1.0]), np.array([inf, 2.0, 1.0])), 0.5)
    assert found.value == 0.0


def test_the_last_look_is_the_whole_campaign():
    values, counts = np.random.default_rng(12).normal(size=300), looks(300)
    assert counts[0] == 20 and counts[-1] == 300 and (np.diff(counts) > 0).all() and looks(7) == [7]
    trace = quantile_traces(values, counts)[1]
    assert trace[-1] == quantile(values, 0.95)
    assert trace[0].high == np.inf  # 20 flights do not bound the 95 % quantile
    first, last = failure_trace(np.isin(np.arange(100), [3, 50]), [20, 100])
    assert (first.value, last.value) == (0.05, 0.02) and last.low < 0.02 < last.high
