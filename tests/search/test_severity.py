import numpy as np

from abhv_mc.search.severity import rank_distinct


def test_flights_with_the_same_samples_count_once_and_uncomputed_ones_never():
    samples = np.array([[0.0], [1.0], [1.0], [3.0], [4.0]])
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 5) == [1, 4, 0]
    assert rank_distinct(np.array([0.0, 5.0, 5.0, -np.inf, 2.0]), samples, 2) == [1, 4]


def test_each_lies_apart_from_all_worse_ones_in_parts_of_the_range():
    samples = np.array([[0.0, 1e-3], [10.0, 0.0], [9.8, 0.0], [5.0, 0.0]])  # second column: 10 % of the rms and more
    assert rank_distinct(np.array([1.0, 4.0, 3.0, 2.0]), samples, 4, apart=0.1) == [1, 3, 0]


def test_a_failure_that_never_comes_is_far_from_those_that_do_and_no_reason_to_drop_a_flight():
    """Of a worst flight without a failure it was the only one in the list, of one with a failure none was without."""
    never = np.inf
    samples = np.array([[never, 1.0], [never, 1.001], [never, 2.0], [10.0, 1.0], [40.0, 1.0], [never, 1.0]])
    severities = np.array([6.0, 5.0, 4.0, 3.0, 2.0, 1.0])
    with np.errstate(all="raise"):
        assert rank_distinct(severities, samples, 6, apart=0.05) == [0, 2, 3, 4]
        assert rank_distinct(severities[::-1].copy(), samples, 6, apart=0.05) == [5, 4, 3, 2]
        assert rank_distinct(severities[:2], samples[:2], 2) == [0, 1]
