"""A map of failures finds planted causes, all of them and nothing else."""

import numpy as np
import pytest

from abhv_mc.analysis.causes import group_failures
from abhv_mc.analysis.shrink import Shrunk, shrink_together
from benchmarks.failure_map import is_mapped, planted


def test_planted_causes_are_mapped_in_nearly_all_campaigns():
    shares = [failed_share(seed) for seed in range(20)]
    assert min(shares) > 0.02 and max(shares) < 0.04
    assert sum(map(is_mapped, range(20))) >= 18


def failed_share(seed):
    _, values, fails = planted(seed)
    return fails(values).any(axis=1).mean()


@pytest.mark.parametrize("budget", [30, 400])
def test_failures_together_shrink_as_alone(budget):
    def test(owners, keep):
        enough = [keep[:, [2, 5]].all(axis=1), keep[:, 7], np.zeros(len(keep), bool)]
        return np.where(np.choose(owners, enough), 1.0, -np.inf)

    pair, single, never = shrink_together(10, test, [np.arange(10)] * 3, budget)
    assert pair.sets == ((2, 5),) and single.sets == ((7,),) and never is None


def test_too_much_is_another_cause_than_too_little():
    found = [Shrunk(((1,),), True, 1)] * 3
    causes, rest = group_failures(found, np.array([[0, 1], [0, 0], [0, 1]], bool))
    assert [(cause.inputs, cause.high, cause.failures) for cause in causes] == [
        ((1,), (True,), (0, 2)),
        ((1,), (False,), (1,)),
    ]
    assert not rest


def test_a_failure_goes_to_the_set_that_explains_most():
    def smallest(*sets):
        return Shrunk(sets, True, 1)

    found = [smallest((1, 2), (3, 4)), smallest((3, 4)), smallest((0,)), None, Shrunk(((1, 2, 3, 4, 5),), False, 9)]
    causes, rest = group_failures(found, np.zeros((5, 6), bool))
    assert [(cause.inputs, cause.failures) for cause in causes] == [((3, 4), (0, 1)), ((0,), (2,))]
    assert rest == [3, 4]
