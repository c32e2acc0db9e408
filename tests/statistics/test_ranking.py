"""Which flights are the worst: early ends first, then the requirements in turn."""

import numpy as np

from abhv_mc.numerics.bounds import Bounds
from abhv_mc.statistics.ranking import Criterion, choose_worst, spread


def test_early_ends_come_first_and_requirements_take_turns():
    early = [(9.0, 7), (3.0, 8)]
    orders = [[1, 2, 3, 4], [2, 1, 5, 6]]
    assert choose_worst(early, orders, 20) == [8, 7, 1, 2, 3, 5, 4, 6]
    for number in range(9):
        assert choose_worst(early, orders, number) == [8, 7, 1, 2, 3, 5, 4, 6][:number]


def test_a_criterion_says_how_far_a_flight_is_beyond_its_limit():
    values = np.array([1.0, -4.0, np.nan])
    assert Criterion("m", "high", Bounds(high=3.0)).excess(values).tolist() == [-2.0, -7.0, np.inf]
    assert Criterion("m", "low", Bounds(low=3.0)).excess(values).tolist() == [2.0, 7.0, np.inf]
    assert Criterion("m", "size").excess(values).tolist() == [1.0, 4.0, np.inf]
    assert Criterion("m", "high", Bounds(0.0, 2.0)).excess(values).tolist() == [-1.0, 4.0, np.inf]


def test_the_spread_is_of_the_middle_ninety_percent():
    assert spread(np.append(np.arange(101.0), np.inf)) == 90.0
    assert spread(np.zeros(3)) == 1.0
