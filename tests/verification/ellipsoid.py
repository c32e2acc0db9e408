"""The way back of abhv_mc.verification.ghame6: from geodetic to Earth-fixed."""

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
