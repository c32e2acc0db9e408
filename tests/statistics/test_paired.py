import numpy as np
import pytest

from abhv_mc.statistics.paired import (
    compare_failures,
    compare_metric,
    compare_usage,
    not_worse,
    pairing_gain,
)

NONE = np.zeros(1000, dtype=bool)


def test_by_how_much():
    draw = np.random.default_rng(8)
    common = draw.normal(10.0, 3.0, 300)
    found = compare_metric(common, common + 0.5 + draw.normal(0.0, 0.1, 300))
    assert found.a_better == 300
    assert found.median_difference.value == pytest.approx(-0.5, abs=0.05)
    assert found.pairing_gain > 100.0


def test_equal_controllers():
    values = np.arange(50.0)
    found = compare_metric(values, values)
    assert found.ties == 50


def test_a_failed_flight_loses():
    a, b = np.array([np.inf, 1.0, np.inf]), np.array([5.0, 2.0, np.inf])
    found = compare_metric(a, b)
    assert (found.a_better, found.b_better, found.ties) == (1, 1, 1)


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


def test_a_little_worse_is_not_worse_by_more():
    draw = np.random.default_rng(66)
    a = draw.lognormal(size=1000)
    b = 1.03 * a * draw.lognormal(0.0, 0.02, 1000)
    assert not_worse(a, b, NONE, NONE, 0.05).shown
    assert not_worse(a, b, NONE, NONE, 0.05).ratio.value == pytest.approx(1.03, abs=0.01)
    assert not not_worse(a, b, NONE, NONE, 0.01).shown
    assert not_worse(-a, -a, NONE, NONE, 0.0).shown  # metrics below zero have no ratio, but an order
    assert not_worse(np.zeros(1000), np.zeros(1000), NONE, NONE, 0.05).shown


def test_just_too_much_worse_is_let_through_as_seldom_as_promised():
    draw = np.random.default_rng(67)
    shown = 0
    for _ in range(1000):
        a = draw.lognormal(size=100)
        shown += not_worse(a, 1.05 * a * draw.lognormal(0.0, 0.1, 100), NONE[:100], NONE[:100], 0.05).shown
    assert 10 <= shown <= 50 + 21


def test_lost_flights_are_worse():
    a = np.ones(1000)
    lost = np.arange(1000) < 600
    assert not not_worse(a, np.where(lost, np.inf, 0.5), NONE, lost, 0.05).shown
    some = np.arange(1000) < 30
    found = not_worse(a, np.where(some, np.inf, 0.5), NONE, some, 0.05)
    assert found.within == 970 and found.loses_more and not found.shown
    assert not_worse(np.where(lost, np.inf, a), a, lost, NONE, 0.05).shown
    assert not_worse(np.full(1000, np.inf), np.full(1000, np.inf), ~NONE, ~NONE, 0.05).shown
    with pytest.raises(ValueError, match="margin"):
        not_worse(a, a, NONE, NONE, -0.1)
