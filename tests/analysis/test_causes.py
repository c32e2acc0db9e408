"""A map of failures finds planted causes, all of them and nothing else."""

import numpy as np
import pytest

from abhv_mc.analysis.failure_map import group_failures
from abhv_mc.analysis.shrink import Shrunk, shrink_together

COUNT, FLIGHTS, BUDGET = 20, 2000, 400


def planted(seed):
    """Causes, two of them pairs, dispersions [flight, input], and what tells which cause makes flights fail."""
    rng = np.random.default_rng(seed)
    inputs = rng.choice(COUNT, 7, replace=False).tolist()
    causes = [(inputs[0],), (inputs[1],), (inputs[2],), (inputs[3], inputs[4]), (inputs[5], inputs[6])]
    values = rng.uniform(-1.0, 1.0, (FLIGHTS, COUNT))
    signs = rng.choice([-1.0, 1.0], COUNT)
    limits = {1: 0.9876, 2: 1.0 - 2.0 * np.sqrt(0.006)}  # 0.62 % and 0.6 % of the flights

    def fails(rows):
        """By cause, ``[flight, cause]``: one-sided, each member beyond its limit."""
        return np.stack([np.all(rows[:, list(c)] * signs[list(c)] > limits[len(c)], axis=1) for c in causes], axis=1)

    return [tuple(sorted(cause)) for cause in causes], values, fails


def is_mapped(seed):
    """Whether the map has the causes that made a flight fail, no other, and no flight that its cause did not fail."""
    causes, values, fails = planted(seed)
    failed = np.flatnonzero(fails(values).any(axis=1))

    def test(owners, keep):
        rows = np.where(keep, values[failed[owners]], 0.0)
        return np.where(fails(rows).any(axis=1), 1.0, -np.inf)

    found = shrink_together(COUNT, test, [np.arange(COUNT)] * failed.size, BUDGET)
    groups, rest = group_failures(found, values[failed] > 0.0)
    flown = fails(values[failed])
    held = {cause: set(np.flatnonzero(flown[:, c])) for c, cause in enumerate(causes) if flown[:, c].any()}
    told = {group.inputs: set(group.failures) for group in groups}
    return not rest and set(told) == set(held) and all(told[cause] <= held[cause] for cause in told)


def test_planted_causes_are_mapped_in_nearly_all_campaigns():
    shares = [failed_share(seed) for seed in range(20)]
    assert min(shares) > 0.02 and max(shares) < 0.04
    assert sum(map(is_mapped, range(20))) >= 18


def failed_share(seed):
    _, values, fails = planted(seed)
    return fails(values).any(axis=1).mean()


def test_a_planted_triple_of_forty_dispersions_is_found_in_every_flight():
    """Pairs of so many are not all tried: the sets found cannot lose a member, and that explains a flight."""
    rng = np.random.default_rng(9)
    values = rng.uniform(-1.0, 1.0, (5000, 40))
    values = values[(values[:, [4, 17, 31]] > 0.5).all(axis=1)][:50]

    def test(owners, keep):
        kept = np.where(keep, values[owners], 0.0)
        return np.where((kept[:, [4, 17, 31]] > 0.5).all(axis=1), 1.0, -np.inf)

    found = shrink_together(40, test, [rng.permutation(40) for _ in values], 400)
    (cause,), rest = group_failures(found, values > 0.0)
    assert cause.inputs == (4, 17, 31) and all(cause.high) and len(cause.failures) == 50 and not rest


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
