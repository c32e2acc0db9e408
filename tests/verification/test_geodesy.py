"""Geodetic, Earth-fixed and inertial positions."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from verification.ellipsoid import ecef_from_geodetic, inertial_from_earth_fixed

from abhv_mc.kernel.world.earth import WGS84
from abhv_mc.verification.geodesy import (
    earth_fixed_from_inertial,
    geodetic_from_ecef,
    ned_from_ecef_matrix,
)

FOOT = 0.3048
LATITUDES = st.floats(-math.pi / 2, math.pi / 2)
LONGITUDES = st.floats(-math.pi, math.pi)
ALTITUDES = st.floats(-1e4, 4e7)


def test_published_point() -> None:
    # EPSG guidance note 7-2 (geographic/geocentric conversions): WGS-84 53 deg 48' 33.820" N, 2 deg 07' 46.380" E,
    # 73.0 m is X = 3771793.968, Y = 140253.342, Z = 5124304.349 m
    latitude = math.radians(53 + 48 / 60 + 33.820 / 3600)
    longitude = math.radians(2 + 7 / 60 + 46.380 / 3600)
    position = ecef_from_geodetic(WGS84, latitude, longitude, 73.0)
    assert position == pytest.approx([3771793.968, 140253.342, 5124304.349], abs=0.02)
    assert geodetic_from_ecef(WGS84, position) == pytest.approx((latitude, longitude, 73.0), abs=2e-9)


@given(LATITUDES, LONGITUDES, ALTITUDES)
def test_geodetic_round_trip(latitude: float, longitude: float, altitude: float) -> None:
    position = ecef_from_geodetic(WGS84, latitude, longitude, altitude)
    again = geodetic_from_ecef(WGS84, position)
    assert again[2] == pytest.approx(altitude, abs=4e-9 + 1e-15 * abs(altitude))
    assert again[0] == pytest.approx(latitude, abs=1e-15)
    assert ecef_from_geodetic(WGS84, *again) == pytest.approx(position, abs=4e-9 + 1e-15 * abs(altitude))


def test_inertial_velocity_of_the_nasa_eastward_cannonball() -> None:
    # NASA/TM-2015-218675, atmospheric case 9, simulator 4: on the equator, 1000 ft/s up and east; then at 0.1 s
    position, velocity = inertial_from_earth_fixed(
        WGS84, 0.0, ecef_from_geodetic(WGS84, 0.0, 0.0, 0.0), [1000 * FOOT, 1000 * FOOT, 0.0]
    )
    assert position / FOOT == pytest.approx([2.09256463255e7, 0.0, 0.0], rel=1e-11)
    assert velocity / FOOT == pytest.approx([1000.0, 2525.92219455, 0.0], rel=1e-11)
    position, velocity = earth_fixed_from_inertial(
        WGS84,
        0.1,
        np.array([2.09257460002e7, 252.427824837, 0.0]) * FOOT,
        np.array([993.503567201, 2522.64037058, 0.0]) * FOOT,
    )
    latitude, longitude, altitude = geodetic_from_ecef(WGS84, position)
    east_down = (ned_from_ecef_matrix(latitude, longitude) @ velocity)[1:] / FOOT
    assert altitude / FOOT == pytest.approx(99.6763098706, abs=2e-4)  # of 2e7 ft, printed to 12 digits
    assert math.degrees(longitude) == pytest.approx(2.73353083227e-4, rel=1e-9)
    assert east_down == pytest.approx([996.698922676, -993.533997806], abs=2e-8)
