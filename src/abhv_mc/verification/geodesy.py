"""Positions on and off the ellipsoid, on the host: geodetic, Earth-centred Earth-fixed (ECEF) and inertial (ECI).

Frames: E turns with the Earth (x through the equator at longitude 0, z through the north pole); I is inertial and
coincides with E at time 0; N is local north, east, down. Angles in rad, lengths in m; arrays broadcast.
"""

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats
from abhv_mc.kernel.world.earth import Earth

_MOST_ITERATIONS = 20


def geodetic_from_ecef(earth: Earth, position: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Geodetic (latitude, longitude, altitude) of a position ``[..., 3]``, m, in E.

    Bowring's iteration of the reduced latitude (Survey Review 23 (1976) 323), to rounding, a few 1e-9 m
    near the ground, where a double itself resolves 1e-9 m. On the axis the longitude is 0.
    """
    x, y, z = np.moveaxis(np.asarray(position, dtype=np.float64), -1, 0)
    a, f = earth.equatorial_radius, earth.flattening
    b = a * (1.0 - f)
    e2 = f * (2.0 - f)
    second_e2 = e2 / (1.0 - e2)
    rho = np.hypot(x, y)
    sin_lat, cos_lat = _unit(z, (1.0 - e2) * rho)
    for _ in range(_MOST_ITERATIONS):
        sin_reduced, cos_reduced = _unit((1.0 - f) * sin_lat, cos_lat)
        before = sin_lat, cos_lat
        sin_lat, cos_lat = _unit(z + second_e2 * b * sin_reduced**3, rho - e2 * a * cos_reduced**3)
        if np.all(np.abs(sin_lat * before[1] - cos_lat * before[0]) < 1e-16):
            break
    altitude = rho * cos_lat + z * sin_lat - a * np.sqrt(1.0 - e2 * sin_lat**2)
    return np.arctan2(sin_lat, cos_lat), np.arctan2(y, x), altitude


def _unit(y: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Sine and cosine of the angle of the point (x, y)."""
    length = np.hypot(x, y)
    return y / length, x / length


def ned_from_ecef_matrix(latitude: ArrayLike, longitude: ArrayLike) -> Floats:
    """C_NE ``[..., 3, 3]``: takes E components of a vector to north, east, down at that place."""
    latitude, longitude = np.broadcast_arrays(latitude, longitude)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
    zero = np.zeros_like(sin_lat)
    north = np.stack([-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat], axis=-1)
    east = np.stack([-sin_lon, cos_lon, zero], axis=-1)
    down = np.stack([-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat], axis=-1)
    return np.stack([north, east, down], axis=-2)


def earth_fixed_from_inertial(
    earth: Earth, time: ArrayLike, position: ArrayLike, velocity: ArrayLike
) -> tuple[Floats, Floats]:
    """Position and velocity relative to the turning Earth, E components, of inertial ones ``[..., 3]``; time in s."""
    angle = earth.rotation_rate * np.asarray(time, dtype=np.float64)
    position = _turn(angle, np.asarray(position, dtype=np.float64))
    velocity = _turn(angle, np.asarray(velocity, dtype=np.float64))
    return position, velocity - np.cross([0.0, 0.0, earth.rotation_rate], position)


def _turn(angle: Floats, vector: Floats) -> Floats:
    """Components in a frame turned by ``angle`` about z."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    turned_x, turned_y, z = np.broadcast_arrays(cosine * x + sine * y, cosine * y - sine * x, z)
    return np.stack([turned_x, turned_y, z], axis=-1)
