"""Rare switches: what comes in one flight of thousands is in no level, and is summed over."""

import numpy as np
import pytest
from search.methods import known_probabilities as known

from abhv_mc.search.methods.strata import MOST_COMBINATIONS, estimate_switched, list_combinations
from abhv_mc.search.methods.subset import SubsetPlan


@pytest.mark.parametrize("case", known.switched_cases(), ids=lambda case: case.name)
def test_rare_switches_are_counted(case):
    """All were refused for two switches, 10 of 24 for eight; more seeds are in benchmarks/rare_coverage.py --missed."""
    given = below = 0
    for seed in range(4):
        found, strata = estimate_switched(case.severity, case.rates, SubsetPlan(4, 0.0, seed))
        given, below = (
            given + (found.refusal is None),
            below + (found.refusal is None and found.high < case.probability),
        )
        assert found.flights <= 20_000 and sum(part.flights for part in strata) == found.flights
        assert sum(part.weight for part in strata) == pytest.approx(1.0, abs=1e-9)
        assert (strata[-1].on is None) == (2 ** len(case.rates) > MOST_COMBINATIONS)
    assert given >= 3 and below == 0


def test_what_plain_flights_see_takes_no_levels():
    """One switch of 5 % always fails; few flights are left for a pilot of 32 combinations and of all others."""
    case = known.switched(1, 0.05, 8.0, fatal=1)
    found, _ = estimate_switched(case.severity, case.rates, SubsetPlan(3, 0.0, 1))
    assert not found.repetitions and found.unwarned_high is None and found.low < 0.05 < found.high
    assert found.flights < 2000
    many = known.switched(8, 2e-3, 4.0, fatal=1)
    assert estimate_switched(many.severity, many.rates, SubsetPlan(3, 0.0, 1, 32), flights=1280)[0].flights <= 1280


def test_combinations_come_by_weight():
    listed = list_combinations(np.array([0.1, 0.4]))
    assert [on for on, _ in listed] == [(), (1,), (0,), (0, 1)]
    assert [weight for _, weight in listed] == pytest.approx([0.54, 0.36, 0.06, 0.04])


def test_the_same_seed_gives_the_same_estimate():
    case = known.switched(1, 1e-4, 3.76, fatal=1)
    one, two = (estimate_switched(case.severity, case.rates, SubsetPlan(2, 0.0, 5))[0] for _ in range(2))
    assert (one.probability, one.low, one.high) == (two.probability, two.low, two.high)
