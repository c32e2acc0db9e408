import numpy as np
import pytest

from abhv_mc.statistics.paired import (
    compare_failures,
    compare_metric,
    compare_usage,
    pairing_gain,
)


def test_by_how_much():
    draw = np.random.default_rng(8)
    common = draw.normal(10.0, 3.0, 300)
    found = compare_metric(common, common + 0.5 + draw.normal(0.0, 0.1, 300))
    assert found.a_better == 300
    assert found.median_difference.value == pytest.approx(-0.5, abs=0.05)
    assert found.pairing_gain > 100.0


def test_a_failed_flight_loses():
    found = compare_metric(np.array([np.inf, 1.0, np.inf, 3.0]), np.array([5.0, 2.0, np.inf, 3.0]))
    assert (found.a_better, found.b_better, found.ties) == (1, 1, 2)


def test_pairing_gain_is_the_ratio_of_variances():
    draw = np.random.default_rng(9)
    a, b = draw.normal(size=20000), draw.normal(size=20000)
    assert pairing_gain(a, b) == pytest.approx(1.0, abs=0.05)  # independent: nothing saved
    assert pairing_gain(a, a) is None


def test_failures_are_cross_counted():
    a = np.array([1, 1, 1, 0, 0, 0, 0], dtype=bool)
    b = np.array([1, 0, 0, 1, 0, 0, 0], dtype=bool)
    found = compare_failures(a, b)
    assert (found.both, found.only_a, found.only_b, found.neither) == (1, 2, 1, 3)
    assert found.p_value == 1.0


def test_usage_quadrants():
    found = compare_usage(
        np.array([1.0, 1.0, 3.0, 3.0, np.inf]),
        np.array([2.0, 2.0, 2.0, 2.0, 2.0]),
        np.array([1.0, 3.0, 1.0, 3.0, 1.0]),
        np.array([2.0, 2.0, 2.0, 2.0, 2.0]),
    )
    assert found.pairs == 4
    assert found.less_error_less_usage == found.less_error_more_usage == 1
    assert found.more_error_less_usage == found.more_error_more_usage == 1
    assert found.error_ratio.value == 1.0
    assert compare_usage(*np.zeros((4, 5))) is None
