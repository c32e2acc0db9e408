"""Rare switches: what comes in one flight of thousands is in no level, and is summed over."""

import numpy as np
import pytest
from scipy.stats import binom, norm

from abhv_mc.search.methods.strata import estimate_switched, list_combinations
from abhv_mc.search.methods.subset import SubsetPlan

GRADUAL = 8.5e-5


def fault_beside_gradual(points, on):
    """The fault always fails; without it the first coordinate has to be far out."""
    return np.where(on[:, 0], 1.0, points[:, 0] - norm.isf(GRADUAL))


@pytest.mark.parametrize("fault", [2e-4, 5e-5])
def test_a_rare_fault_is_counted(fault):
    """The interval lay wholly below the truth in 51 and 42 %; 200 seeds are in benchmarks/rare_coverage.py."""
    truth = fault + (1.0 - fault) * GRADUAL
    given = below = 0
    for seed in range(12):
        found, strata = estimate_switched(fault_beside_gradual, np.array([fault]), SubsetPlan(4, 0.0, seed))
        given, below = given + (found.refusal is None), below + (found.refusal is None and found.high < truth)
        assert found.flights <= 20_000 and strata[1].on == (0,) and strata[1].probability == 1.0
    assert given >= 10 and below <= 1


def test_more_combinations_than_are_flown_one_by_one_are_a_stratum():
    rates = np.full(7, 2e-3)

    def severity(points, on):
        return np.where(on.sum(axis=1) >= 2, 1.0, points[:, 0] - 4.0 + 0.5 * on.sum(axis=1))

    shares = binom.pmf(np.arange(8), 7, 2e-3)  # of so many switches that are on
    truth = shares[0] * norm.sf(4.0) + shares[1] * norm.sf(3.5) + shares[2:].sum()
    found, strata = estimate_switched(severity, rates, SubsetPlan(3, 0.0, 1))
    assert strata[-1].on is None and len(strata) == 33
    assert sum(part.weight for part in strata) == pytest.approx(1.0, abs=1e-9)
    assert found.refusal is None and found.low < truth < found.high and found.flights <= 20_000


def test_combinations_come_by_weight():
    listed = list_combinations(np.array([0.1, 0.4]))
    assert [on for on, _ in listed] == [(), (1,), (0,), (0, 1)]
    assert [weight for _, weight in listed] == pytest.approx([0.54, 0.36, 0.06, 0.04])


def test_the_same_seed_gives_the_same_estimate():
    one, two = (estimate_switched(fault_beside_gradual, np.array([1e-4]), SubsetPlan(2, 0.0, 5))[0] for _ in range(2))
    assert (one.probability, one.low, one.high) == (two.probability, two.low, two.high)
