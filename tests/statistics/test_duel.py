import numpy as np
import pytest

from abhv_mc.statistics.bootstrap import PairedBootstrap
from abhv_mc.statistics.duel import failure_duel, metric_duel, pairing_gain, usage_duel


def test_who_wins_and_by_how_much():
    draw = np.random.default_rng(8)
    common = draw.normal(10.0, 3.0, 300)
    found = metric_duel(common, common + 0.5 + draw.normal(0.0, 0.1, 300), PairedBootstrap(300, 200))
    assert found.winner == "a"
    assert found.a_better == 300
    assert found.median_difference.value == pytest.approx(-0.5, abs=0.05)
    assert found.pairing_gain > 100.0


def test_equal_controllers_have_no_winner():
    values = np.arange(50.0)
    found = metric_duel(values, values, PairedBootstrap(50, 50))
    assert (found.winner, found.ties) == ("", 50)


def test_closer_on_more_flights_but_larger_in_the_median_wins_nothing():
    flight = np.arange(500)
    a = np.where(flight < 200, 0.9, 1.5)
    b = np.where(flight >= 400, np.inf, 1.0)
    found = metric_duel(a, b, PairedBootstrap(500, 50))
    assert (found.a_better, found.b_better) == (300, 200) and found.median_difference.high < 0.0
    assert found.mixed and found.winner == ""


def test_a_failed_flight_loses():
    a, b = np.array([np.inf, 1.0, np.inf]), np.array([5.0, 2.0, np.inf])
    found = metric_duel(a, b, PairedBootstrap(3, 50))
    assert (found.a_better, found.b_better, found.ties) == (1, 1, 1)


def test_pairing_gain_is_the_ratio_of_variances():
    draw = np.random.default_rng(9)
    a, b = draw.normal(size=20000), draw.normal(size=20000)
    assert pairing_gain(a, b) == pytest.approx(1.0, abs=0.05)  # independent: nothing saved
    assert pairing_gain(a, a) is None


def test_failures_are_cross_counted():
    a = np.array([1, 1, 1, 0, 0, 0, 0], dtype=bool)
    b = np.array([1, 0, 0, 1, 0, 0, 0], dtype=bool)
    found = failure_duel(a, b)
    assert (found.both, found.only_a, found.only_b, found.neither) == (1, 2, 1, 3)
    assert found.p_value == 1.0


def test_usage_quadrants():
    found = usage_duel(
        np.array([1.0, 1.0, 3.0, 3.0, np.inf]),
        np.array([2.0, 2.0, 2.0, 2.0, 2.0]),
        np.array([1.0, 3.0, 1.0, 3.0, 1.0]),
        np.array([2.0, 2.0, 2.0, 2.0, 2.0]),
    )
    assert found.pairs == 4
    assert found.less_error_less_usage == found.less_error_more_usage == 1
    assert found.more_error_less_usage == found.more_error_more_usage == 1
    assert found.error_ratio.value == 1.0
    assert usage_duel(*np.zeros((4, 5))) is None
