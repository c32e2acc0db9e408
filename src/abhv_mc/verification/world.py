"""Atmosphere, gravity and geodesy against published numbers."""

from importlib.util import find_spec

import numpy as np

from abhv_mc.verification.rows import Row
from abhv_mc.world.atmosphere import atmosphere
from abhv_mc.world.earth import WGS84, gravity_ned, radii
from abhv_mc.world.geodesy import ecef_from_geodetic, geodetic_from_ecef

# U.S. Standard Atmosphere 1976, NOAA-S/T 76-1562, table I: geometric altitude m, kinetic temperature K, pressure Pa,
# density kg/m3, as printed.
US_1976 = (
    (0.0, 288.150, 1.01325e5, 1.2250e0),
    (5000.0, 255.676, 5.4048e4, 7.3643e-1),
    (10000.0, 223.252, 2.6500e4, 4.1351e-1),
    (15000.0, 216.650, 1.2112e4, 1.9476e-1),
    (20000.0, 216.650, 5.5293e3, 8.8910e-2),
    (25000.0, 221.552, 2.5492e3, 4.0084e-2),
    (30000.0, 226.509, 1.1970e3, 1.8410e-2),
    (40000.0, 250.350, 2.8714e2, 3.9957e-3),
    (50000.0, 270.650, 7.9779e1, 1.0269e-3),
    (60000.0, 247.021, 2.1959e1, 3.0968e-4),
    (70000.0, 219.585, 5.2209e0, 8.2829e-5),
    (80000.0, 198.639, 1.0525e0, 1.8458e-5),
)
_FOOT = 0.3048  # m
_J4 = -2.37091222e-6  # WGS-84's next zonal, which normal gravity has and the plant has not


def verify_atmosphere() -> list[Row]:
    """Rows against the printed table and, where it is installed, against ambiance."""
    published = np.array(US_1976)
    ours = np.array([atmosphere(altitude) for altitude in published[:, 0]])
    rows = [
        Row("atmosphere", "US 1976 table I", "temperature", "K", _worst(ours[:, 2] - published[:, 1]), 6e-4),
        Row("atmosphere", "US 1976 table I", "pressure", "relative", _worst(ours[:, 1] / published[:, 2] - 1), 5e-5),
        Row("atmosphere", "US 1976 table I", "density", "relative", _worst(ours[:, 0] / published[:, 3] - 1), 5e-5),
    ]
    if find_spec("ambiance"):
        from ambiance import Atmosphere

        altitude = np.linspace(-5e3, 80e3, 1701)
        other = Atmosphere(altitude)
        ours = np.array([atmosphere(float(z)) for z in altitude])
        named = {"density": other.density, "pressure": other.pressure, "temperature": other.temperature}
        for i, (name, values) in enumerate(named.items()):
            rows.append(Row("atmosphere", "ambiance", name, "relative", _worst(ours[:, i] / values - 1), 1e-5))
    return rows


def verify_earth() -> list[Row]:
    """Rows of the ellipsoid and of gravity. NIMA TR8350.2 (WGS-84); NASA/TM-2015-218675 for the J2 field."""
    meridian, _ = radii(WGS84, 0.0)
    polar, _ = radii(WGS84, 1.0)
    mean = WGS84.gravitational_parameter / WGS84.equatorial_radius**2
    at_equator = gravity_ned(WGS84, 0.0, 0.0, 1.0)[1] - 5.0 * mean * _J4 * 3.0 / 8.0
    at_pole = gravity_ned(WGS84, 0.0, 1.0, 0.0)[1] - 5.0 * mean * _J4 / (1.0 - WGS84.flattening) ** 6
    still = WGS84._replace(rotation_rate=0.0)
    attraction = gravity_ned(still, 0.0, 0.0, 1.0)[1] / _FOOT

    generator = np.random.default_rng(76)
    latitude, longitude = generator.uniform(-1.57, 1.57, 2000), generator.uniform(-3.14, 3.14, 2000)
    altitude = generator.uniform(-1e3, 1e5, 2000)
    back = geodetic_from_ecef(WGS84, ecef_from_geodetic(WGS84, latitude, longitude, altitude))
    apart = max(_worst(back[0] - latitude), _worst(back[1] - longitude)) * WGS84.equatorial_radius
    return [
        Row("ellipsoid", "WGS-84", "meridian radius at the equator", "m", abs(meridian - 6335439.3273), 1e-3),
        Row("ellipsoid", "WGS-84", "polar radius of curvature", "m", abs(polar - 6399593.6258), 1e-4),
        Row("ellipsoid", "itself", "there and back, altitude", "m", _worst(back[2] - altitude), 1e-8),
        Row("ellipsoid", "itself", "there and back, over ground", "m", apart, 1e-8),
        Row("gravity", "WGS-84", "at the equator, with J4", "m/s2", abs(at_equator - 9.7803253359), 5e-7),
        Row("gravity", "WGS-84", "at the pole, with J4", "m/s2", abs(at_pole - 9.8321849378), 5e-7),
        Row("gravity", "nesc 09, sim 04", "attraction at the start", "ft/s2", abs(attraction - 32.1988102141), 1e-9),
    ]


def _worst(differences: np.ndarray) -> float:
    return float(np.abs(differences).max())
