import numpy as np

from abhv_mc.campaign.search.severity import rank_distinct


def test_flights_with_the_same_samples_count_once_and_uncomputed_ones_never():
    samples = np.array([[0.0], [1.0], [1.0], [3.0], [4.0]])
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 5) == [1, 4, 0]
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 2) == [1, 4]


def test_each_lies_apart_from_all_worse_ones_in_parts_of_the_range():
    samples = np.array([[0.0, 1e-3], [10.0, 0.0], [9.8, 0.0], [5.0, 0.0]])  # second column: 10 % of the rms and more
    assert rank_distinct(np.array([1.0, 4.0, 3.0, 2.0]), samples, 4, apart=0.1) == [1, 3, 0]


def test_a_parameter_that_never_changes_does_not_count():
    samples = np.column_stack([np.full(3, 7.0), [0.0, 1.0, 0.0]])
    assert rank_distinct(np.array([1.0, 2.0, 3.0]), samples, 3) == [2, 1]
