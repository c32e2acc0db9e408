"""What the studies count and decide, on made-up curves."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "studies"))

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
