"""Figure, gravity and rotation of the Earth; air and gravity at many points.

The Earth is optionally a non-rotating sphere. Air, gravity and radii of curvature at many points
are computed in one call from Python.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.jit import kernel, scalar
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere


class Earth(NamedTuple):
    """Figure, gravity and rotation of the Earth, SI units."""

    equatorial_radius: float  # equatorial radius, m
    flattening: float  # flattening, 0 for a sphere
    gravitational_parameter: float  # GM, m3/s2
    j2: float  # second zonal harmonic, 0 for a central field
    rotation_rate: float  # rotation rate, rad/s; 0 without rotation
    # factor on J2's attraction towards the equator; differs from 1 only to replay a faulty model
    j2_meridional: float = 1.0


WGS84 = Earth(6378137.0, 1.0 / 298.257223563, 3.986004418e14, 1.08262982e-3, 7.292115e-5)


@scalar
def radii(earth: Earth, sin_lat: float) -> tuple[float, float]:
    """Return the radii of curvature in the meridian (M) and the prime vertical (N), m."""
    e2 = earth.flattening * (2.0 - earth.flattening)
    w2 = 1.0 - e2 * sin_lat * sin_lat
    per_w = 1.0 / math.sqrt(w2)
    prime_vertical = earth.equatorial_radius * per_w
    return prime_vertical * ((1.0 - e2) * (per_w * per_w)), prime_vertical


@scalar
def gravity_ned(
    earth: Earth, altitude: float, sin_lat: float, cos_lat: float
) -> tuple[float, float]:
    """Return gravity (north, down), m/s2, including the centrifugal acceleration.

    ``altitude`` (m) and latitude are geodetic. The attraction is the exact gradient of the
    potential -(GM/r) (1 - J2 (a/r)^2 P2(z/r)), resolved along the ellipsoid's normal, without an
    east component. On the WGS-84 ellipsoid it differs by at most 1.2e-4 m/s2 from normal gravity,
    which includes the other even zonal harmonics.
    """
    e2 = earth.flattening * (2.0 - earth.flattening)
    _, prime_vertical = radii(earth, sin_lat)
    rho = (prime_vertical + altitude) * cos_lat  # distance from the axis
    z = (prime_vertical * (1.0 - e2) + altitude) * sin_lat  # distance from the equatorial plane
    inverse_square = 1.0 / (rho * rho + z * z)
    central = earth.gravitational_parameter * inverse_square * math.sqrt(inverse_square)
    j2_term = 1.5 * earth.j2 * earth.equatorial_radius * earth.equatorial_radius * inverse_square
    # The factor changes the meridional attraction of J2, which is -2 j2_term central rho z / r.
    taken = 2.0 * (1.0 - earth.j2_meridional)
    tilt = (5.0 - taken) * (z * z * inverse_square)
    g_rho = (
        earth.rotation_rate * earth.rotation_rate - central * (1.0 + j2_term * (1.0 - tilt))
    ) * rho
    g_z = -central * (1.0 + j2_term * (3.0 - taken - tilt)) * z
    return g_z * cos_lat - g_rho * sin_lat, -(g_rho * cos_lat + g_z * sin_lat)


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
        altitude = points[0, i]
        sin_lat = points[1, i]
        cos_lat = points[2, i]
        result[0, i], _, _, result[1, i] = atmosphere(altitude)
        result[2, i], result[3, i] = gravity_ned(earth, altitude, sin_lat, cos_lat)
        result[4, i], result[5, i] = radii(earth, sin_lat)


def find_surroundings(
    earth: Earth, altitude: ArrayLike, sin_lat: ArrayLike, cos_lat: ArrayLike
) -> Surroundings:
    """Return the surroundings at points with the given altitudes (m) and latitudes.

    A loop that calls compiled functions from Python would take 100 times as long.
    """
    points = np.array(np.broadcast_arrays(altitude, sin_lat, cos_lat), np.float64)
    result = np.empty((len(Surroundings._fields), *points.shape[1:]))
    _fill(earth, points.reshape(3, -1), result.reshape(len(result), -1))
    return Surroundings(*result)


@lru_cache(maxsize=64)
def standard_air(altitude: float) -> tuple[float, float]:
    """Return density (kg/m3) and speed of sound (m/s) of the standard atmosphere."""
    air = find_surroundings(WGS84, altitude, 0.0, 1.0)
    return float(air.density), float(air.sound_speed)
