"""What the studies count and decide, on made-up curves."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))

import fronts
import tuning_flights
from experiment import CORNERS, corner_parameters, random_parameters

from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX


@pytest.mark.parametrize(("amplitude", "cycles", "swings"), [(1.0, 4, 8), (0.2, 9, 0), (0.26, 3, 6)])
def test_swings_are_counted_where_they_are_large(amplitude: float, cycles: int, swings: int) -> None:
    times = np.linspace(0.0, 1.0, 2001)
    wave = amplitude * np.sin(2.0 * np.pi * cycles * times)
    assert abs(tuning_flights.count_swings(wave.astype(np.float32)) - swings) <= 1
    chatter = 0.01 * np.sin(2.0 * np.pi * 300.0 * times)
    assert tuning_flights.count_swings((wave + chatter).astype(np.float32)) <= swings + 1


def test_a_drift_is_no_swing() -> None:
    assert tuning_flights.count_swings(np.linspace(0.0, 0.4, 100, dtype=np.float32)) == 0


def test_the_corners_and_the_draws_are_the_papers() -> None:
    columns = [PARAMETER_INDEX[name] for name in ("atmosphere.density", "aero.lift", "aero.drag")]
    corners = corner_parameters()[:, columns]
    assert corners[0].tolist() == [1.0, 1.0, 1.0]
    np.testing.assert_allclose(corners[1:], 1.0 + np.array(CORNERS) * (0.10, 0.10, 0.15))
    drawn = random_parameters(2000)[:, columns]
    np.testing.assert_allclose(np.abs(drawn - 1.0).max(axis=0), (0.10, 0.10, 0.15), rtol=0.01)


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
