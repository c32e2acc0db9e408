"""Figure, gravity and rotation of the Earth, optionally as a non-rotating sphere."""

import math
from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import scalar


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
