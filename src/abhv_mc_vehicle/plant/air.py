"""Nominal air of a mission: the standard atmosphere times the factors of the mission's table."""

from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.kernel.world.surroundings import find_surroundings


def nominal_air(air: Floats | None, altitude: Any) -> tuple[Floats, Floats]:
    """Return density (kg/m3) and speed of sound (m/s) [point] at altitudes (m).

    ``air`` has the columns of :mod:`abhv_mc_vehicle.kernel.plant.air_data`; None or a table without
    rows is the standard atmosphere.
    """
    density, sound_speed, *_ = find_surroundings(WGS84, altitude, 0.0, 1.0)
    if air is None or not len(air):
        return density, sound_speed
    factor, warmth = (np.interp(altitude, air[:, 0], air[:, column]) for column in (3, 4))
    return density * factor, sound_speed * np.sqrt(warmth)
