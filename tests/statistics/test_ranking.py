"""Which flights are the worst: early ends first, then the largest distance beyond a limit."""

import numpy as np

from abhv_mc.bounds import Bounds
from abhv_mc.statistics.ranking import Criterion, spread, worst_first


def test_early_ends_come_first_and_equals_keep_their_order():
    lost_at = np.array([np.inf, 9.0, np.inf, 3.0, np.inf])
    assert worst_first(lost_at, np.array([0.5, np.inf, 0.7, np.inf, 0.5])).tolist() == [3, 1, 2, 0, 4]


def test_distances_are_in_units_of_the_limit_or_of_the_span_where_it_is_zero():
    values = np.linspace(-1.0, 3.0, 401)
    assert Criterion("m", "high", Bounds(high=-5.0)).scale(values) == (0.0, 5.0)
    assert Criterion("m", "high", Bounds(1.0, 2.0)).scale(values) == (0.0, 0.5)
    assert np.allclose(Criterion("m", "low", Bounds(low=0.0)).scale(values), (0.0, 0.9 * 4.0))
    assert np.allclose(Criterion("m", "low").scale(values), (-1.0, 1.0))  # without limits: from the median, in its size
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
