"""Smallest sets of planted causes among idle inputs, and maps of failures."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.analysis.failure_map import group_failures
from abhv_mc.analysis.shrink import Shrunk, shrink

COUNT = 25
ORDER = np.arange(COUNT)


def shrink_one(test, order=ORDER, budget=4000):
    return shrink(len(order), lambda _, keep: test(keep), [order], budget)[0]


def failing(*causes, count=COUNT):
    """A test in which any of the sets `causes` suffices, badly by its place in the list."""

    def test(keep):
        assert keep.shape[1] == count
        severity = np.full(len(keep), -np.inf)
        for k, cause in enumerate(causes):
            severity = np.where(keep[:, list(cause)].all(axis=1), np.maximum(severity, k), severity)
        return severity

    return test


@pytest.mark.parametrize("cause", [(3,), (2, 19), (0, 11, 24)])
def test_the_planted_set_is_found_and_proven_smallest(cause):
    shrunk = shrink_one(failing(cause))
    assert shrunk.sets == (cause,) and shrunk.smallest
    assert shrunk.tried == sum(
        1 for size in range(len(cause) + 1) for _ in combinations(range(COUNT), size)
    )
    fewer = shrink_one(
        failing(cause), budget=400
    )  # pairs: a set one larger than all that were tried is the smallest
    assert fewer.sets == shrunk.sets and fewer.smallest


def test_all_sets_of_the_smallest_size_are_told_worst_first():
    shrunk = shrink_one(failing((1, 2), (4, 5), (3, 7, 8)))
    assert shrunk.sets == ((4, 5), (1, 2)) and shrunk.smallest


@given(st.sets(st.integers(0, COUNT - 1), min_size=4, max_size=12), st.permutations(range(COUNT)))
def test_large_sets_are_shrunk_until_every_member_is_needed(cause, order):
    shrunk = shrink_one(failing(tuple(cause)), np.array(order), 400)
    assert shrunk.sets == (tuple(sorted(cause)),)
    assert not shrunk.smallest  # up to pairs were tried: a set of three was never ruled out
    assert shrunk.tried < 400 + 60 * COUNT


def test_more_can_be_less():
    """Test a failure that other inputs cure.

    The whole set fails because of what it contains, not because of what it lacks.
    """

    def test(keep):
        cured = keep[:, 5] & ~keep[:, 6]
        return np.where(keep[:, 0] & keep[:, 1] & keep[:, 2] & ~cured, 1.0, -np.inf)

    assert shrink_one(test, budget=30).sets == ((0, 1, 2),)


@pytest.mark.parametrize("budget", [30, 400])
def test_failures_together_shrink_as_alone(budget):
    def test(owners, keep):
        enough = [
            keep[:, [2, 5]].all(axis=1),
            keep[:, 7],
            np.zeros(len(keep), bool),
            np.ones(len(keep), bool),
        ]
        return np.where(np.choose(owners, enough), 1.0, -np.inf)

    pair, single, never, always = shrink(10, test, [np.arange(10)] * 4, budget)
    assert (
        pair.sets == ((2, 5),) and single.sets == ((7,),) and never is None and always.sets == ((),)
    )


def is_mapped(seed, count=20, flights=2000):
    """Return whether the map has exactly the planted causes and their flights."""
    rng = np.random.default_rng(seed)
    inputs = rng.choice(count, 7, replace=False).tolist()
    causes = [tuple(sorted(inputs[i:j])) for i, j in ((0, 1), (1, 2), (2, 3), (3, 5), (5, 7))]
    values, signs = rng.uniform(-1.0, 1.0, (flights, count)), rng.choice([-1.0, 1.0], count)
    limits = {1: 0.9876, 2: 1.0 - 2.0 * np.sqrt(0.006)}  # 0.62 % and 0.6 % of the flights

    def fails(rows):
        """Return the mask [flight, cause] of failures."""
        return np.stack(
            [np.all(rows[:, list(c)] * signs[list(c)] > limits[len(c)], axis=1) for c in causes],
            axis=1,
        )

    values = values[fails(values).any(axis=1)]

    def test(owners, keep):
        return np.where(fails(np.where(keep, values[owners], 0.0)).any(axis=1), 1.0, -np.inf)

    groups = group_failures(
        shrink(count, test, [np.arange(count)] * len(values), 400), values > 0.0
    )
    flown = fails(values)
    planted = {
        cause: set(np.flatnonzero(flown[:, c]))
        for c, cause in enumerate(causes)
        if flown[:, c].any()
    }
    mapped = {group.inputs: set(group.failures) for group in groups}
    is_complete = set().union(*mapped.values()) == set(range(len(values)))
    return (
        is_complete
        and set(mapped) == set(planted)
        and all(mapped[cause] <= planted[cause] for cause in mapped)
    )


def test_planted_causes_are_mapped_in_nearly_all_campaigns():
    assert sum(map(is_mapped, range(20))) >= 18


def test_a_failure_is_assigned_to_the_set_that_explains_most_and_causes_have_signs():
    sets = [((1, 2), (3, 4)), ((3, 4),), ((0,),), ((1, 2, 3, 4, 5),), ((0,),)]
    explanations = [None, *(Shrunk(members, True, 1) for members in sets)]
    high = np.zeros((6, 6), bool)
    high[5, 0] = True
    causes = [
        (cause.inputs, cause.high, cause.failures) for cause in group_failures(explanations, high)
    ]
    assert causes == [
        ((3, 4), (False, False), (1, 2)),
        ((0,), (False,), (3,)),
        ((0,), (True,), (5,)),
    ]
