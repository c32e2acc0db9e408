"""The study of error against control usage: limits and fronts, on made-up candidates."""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))

import fronts


def made_up(errors: list[float], usages: list[list[float]], broken: tuple[int, ...] = ()) -> fronts.Tried:
    count = len(errors)
    limits = np.full((count, fronts.LIMITS), -0.1)
    limits[list(broken), 1] = 0.1
    return fronts.Tried(np.zeros((count, 14)), np.tile(np.array(errors)[:, None], 6), np.array(usages), limits)


def test_a_front_is_of_designs_within_limits_that_none_beats() -> None:
    usage = [[u] * 6 for u in (0.5, 0.6, 0.7, 0.8, 0.4)]
    tried = made_up([1.0, 1.1, 0.9, 0.8, 0.5], usage, broken=(4,))
    np.testing.assert_allclose(tried.front.mean_usage, [0.5, 0.7, 0.8])
    again = fronts.tried_of(tried.table)
    np.testing.assert_array_equal(again.limits, tried.limits)
    np.testing.assert_array_equal(again.usage, tried.usage)


def test_the_best_within_a_budget_keeps_it() -> None:
    tried = made_up([1.0, 0.9, 0.8], [[u] * 6 for u in (0.5, 0.7, 0.9)])
    assert int(np.argmin(tried.within(0.75).rank())) == 1
    assert int(np.argmin(tried.within(0.3).rank())) == 0  # none keeps it: the nearest
