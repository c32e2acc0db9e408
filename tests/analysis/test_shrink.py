"""Planted causes among idle inputs are found, all of them and nothing else."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.analysis.shrink import shrink

COUNT = 25
ORDER = np.arange(COUNT)


def failing(*causes, of=COUNT):
    """A test in which any of the sets `causes` suffices, badly by its place in the list."""

    def test(keep):
        assert keep.shape[1] == of
        severity = np.full(len(keep), -np.inf)
        for k, cause in enumerate(causes):
            severity = np.where(keep[:, list(cause)].all(axis=1), np.maximum(severity, k), severity)
        return severity

    return test


@pytest.mark.parametrize("cause", [(3,), (2, 19), (0, 11, 24)])
def test_the_planted_set_is_found_and_proven_smallest(cause):
    found = shrink(COUNT, failing(cause), ORDER)
    assert found.sets == (cause,) and found.smallest
    assert found.tried == sum(1 for size in range(len(cause) + 1) for _ in combinations(range(COUNT), size))


def test_all_sets_of_the_smallest_size_are_told_worst_first():
    found = shrink(COUNT, failing((1, 2), (4, 5), (3, 7, 8)), ORDER)
    assert found.sets == ((4, 5), (1, 2)) and found.smallest


@given(st.sets(st.integers(0, COUNT - 1), min_size=4, max_size=12), st.permutations(range(COUNT)))
def test_large_sets_are_shrunk_until_every_member_is_needed(cause, order):
    found = shrink(COUNT, failing(tuple(cause)), np.array(order), budget=400)
    assert found.sets == (tuple(sorted(cause)),)
    assert not found.smallest  # up to pairs were tried: a set of three was never ruled out
    assert found.tried < 400 + 60 * COUNT


def test_a_set_one_larger_than_all_that_were_tried_is_the_smallest():
    found = shrink(COUNT, failing((0, 11, 24)), ORDER, budget=400)
    assert found.sets == ((0, 11, 24),) and found.smallest


def test_more_can_be_less():
    """A failure that other inputs cure: the whole fails only because of what it has, not of what it lacks."""

    def test(keep):
        cured = keep[:, 5] & ~keep[:, 6]
        return np.where(keep[:, 0] & keep[:, 1] & keep[:, 2] & ~cured, 1.0, -np.inf)

    assert shrink(COUNT, test, ORDER, budget=30).sets == ((0, 1, 2),)


def test_what_always_fails_needs_nothing_and_what_never_fails_is_refused():
    assert shrink(COUNT, lambda keep: np.ones(len(keep)), ORDER).sets == ((),)
    for count, budget in ((3, 4000), (COUNT, 30)):
        with pytest.raises(ValueError, match="do not fail"):
            shrink(count, lambda keep: np.full(len(keep), -np.inf), np.arange(count), budget)
