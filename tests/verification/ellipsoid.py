"""The ways back of abhv_mc.verification.geodesy: from geodetic to Earth-fixed, from Earth-fixed to inertial."""

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats
from abhv_mc.kernel.world.earth import Earth


def ecef_from_geodetic(earth: Earth, latitude: ArrayLike, longitude: ArrayLike, altitude: ArrayLike) -> Floats:
    """Position ``[..., 3]``, m, in E of a geodetic latitude, longitude and altitude."""
    latitude, longitude, altitude = np.broadcast_arrays(latitude, longitude, altitude)
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    e2 = earth.flattening * (2.0 - earth.flattening)
    prime_vertical = earth.equatorial_radius / np.sqrt(1.0 - e2 * sin_lat**2)
    rho = (prime_vertical + altitude) * cos_lat
    z = (prime_vertical * (1.0 - e2) + altitude) * sin_lat
    return np.stack([rho * np.cos(longitude), rho * np.sin(longitude), z], axis=-1)


def inertial_from_earth_fixed(
    earth: Earth, time: ArrayLike, position: ArrayLike, velocity: ArrayLike
) -> tuple[Floats, Floats]:
    """Inertial position and velocity, I components, of a motion relative to the turning Earth ``[..., 3]``."""
    angle = earth.rotation_rate * np.asarray(time, dtype=np.float64)
    cosine, sine, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = ([cosine, -sine, zero], [sine, cosine, zero], [zero, zero, one])
    turn = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    carried = np.cross([0.0, 0.0, earth.rotation_rate], position)
    return tuple(np.einsum("...ij,...j->...i", turn, vector) for vector in (position, np.add(velocity, carried)))
