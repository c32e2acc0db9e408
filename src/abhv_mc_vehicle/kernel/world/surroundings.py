"""Air, gravity and radii of curvature at many points, computed in one call from Python."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.kernel.world.earth import WGS84, Earth, gravity_ned, radii


class Surroundings(NamedTuple):
    """Standard air, gravity and radii of curvature [point], or of a single point, in SI units."""

    density: Floats
    sound_speed: Floats
    gravity_north: Floats
    gravity_down: Floats
    meridian: Floats  # radius of curvature in the meridian
    prime_vertical: Floats  # radius of curvature in the prime vertical


@kernel
def _fill(earth, points, result):
    for i in range(points.shape[1]):
        altitude, sin_lat, cos_lat = points[0, i], points[1, i], points[2, i]
        result[0, i], _, _, result[1, i] = atmosphere(altitude)
        result[2, i], result[3, i] = gravity_ned(earth, altitude, sin_lat, cos_lat)
        result[4, i], result[5, i] = radii(earth, sin_lat)


def find_surroundings(
    earth: Earth, altitude: ArrayLike, sin_lat: ArrayLike, cos_lat: ArrayLike
) -> Surroundings:
    """Return the surroundings at points with the given altitudes (m) and latitudes.

    A loop that calls compiled functions from Python would take 100 times as long.
    """
    points = np.array(np.broadcast_arrays(altitude, sin_lat, cos_lat), dtype=np.float64)
    result = np.empty((len(Surroundings._fields), *points.shape[1:]))
    _fill(earth, points.reshape(3, -1), result.reshape(len(result), -1))
    return Surroundings(*result)


@lru_cache(maxsize=64)
def standard_air(altitude: float) -> tuple[float, float]:
    """Return density (kg/m3) and speed of sound (m/s) of the standard atmosphere."""
    air = find_surroundings(WGS84, altitude, 0.0, 1.0)
    return float(air.density), float(air.sound_speed)
