"""Radii of curvature and gravity of the Earth record."""

import math

import mpmath
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.kernel.world.earth import WGS84, Earth, gravity_ned, radii

LATITUDES = st.floats(-math.pi / 2, math.pi / 2)
ALTITUDES = st.floats(-1e3, 2e5)


def test_wgs84_radii_of_curvature() -> None:
    # NIMA TR8350.2 (3rd ed.): semi-minor axis 6356752.3142 m, polar radius of curvature 6399593.6258 m
    meridian, prime_vertical = radii(WGS84, 0.0)
    assert prime_vertical == 6378137.0
    assert meridian == pytest.approx(6356752.3142**2 / 6378137.0, abs=1e-3)
    assert radii(WGS84, 1.0) == pytest.approx((6399593.6258, 6399593.6258), abs=1e-4)


def test_wgs84_gravity_is_normal_gravity_but_for_the_higher_zonals() -> None:
    # NIMA TR8350.2: normal gravity 9.7803253359 m/s2 at the equator, 9.8321849378 m/s2 at the poles.
    # J4 alone accounts for the difference: 5 GM/a2 (a/r)^6 J4 P4 with J4 = -2.37e-6.
    zonal_4 = -2.37091222e-6
    equator_north, equator = gravity_ned(WGS84, 0.0, 0.0, 1.0)
    pole_north, pole = gravity_ned(WGS84, 0.0, 1.0, 0.0)
    mean = 3.986004418e14 / 6378137.0**2
    b_over_a = 1 - WGS84.flattening
    assert equator - 5 * mean * zonal_4 * 3 / 8 == pytest.approx(9.7803253359, abs=5e-7)
    assert pole - 5 * mean * zonal_4 / b_over_a**6 == pytest.approx(9.8321849378, abs=5e-7)
    assert (equator_north, pole_north) == pytest.approx((0.0, 0.0), abs=1e-15)


@given(LATITUDES, ALTITUDES)
def test_still_sphere_pulls_straight_down(latitude: float, altitude: float) -> None:
    sphere = Earth(6371000.0, 0.0, 3.986004418e14, 0.0, 0.0)
    north, down = gravity_ned(sphere, altitude, math.sin(latitude), math.cos(latitude))
    assert north == pytest.approx(0.0, abs=1e-14)
    assert down == pytest.approx(3.986004418e14 / (6371000.0 + altitude) ** 2, rel=1e-14)
    assert radii(sphere, math.sin(latitude)) == (6371000.0, 6371000.0)


@given(LATITUDES, ALTITUDES)
def test_rotation_adds_the_centrifugal_acceleration(latitude: float, altitude: float) -> None:
    sphere = Earth(6371000.0, 0.0, 0.0, 0.0, 7.292115e-5)
    north, down = gravity_ned(sphere, altitude, math.sin(latitude), math.cos(latitude))
    outward = 7.292115e-5**2 * (6371000.0 + altitude) * math.cos(latitude)
    assert north == pytest.approx(-outward * math.sin(latitude), abs=1e-15)
    assert down == pytest.approx(-outward * math.cos(latitude), abs=1e-15)


@pytest.mark.parametrize("latitude", [-1.2, 0.3, 0.8, 1.5])
def test_attraction_is_the_gradient_of_the_potential(latitude: float) -> None:
    mpmath.mp.dps = 40
    still = WGS84._replace(rotation_rate=0.0)
    altitude = 20000.0
    sine, cosine = mpmath.sin(latitude), mpmath.cos(latitude)
    _, n = radii(still, math.sin(latitude))
    e2 = still.flattening * (2 - still.flattening)

    def potential(north: mpmath.mpf, up: mpmath.mpf) -> mpmath.mpf:
        rho = (n + altitude) * cosine - north * sine + up * cosine
        z = (n * (1 - e2) + altitude) * sine + north * cosine + up * sine
        r = mpmath.sqrt(rho**2 + z**2)
        p2 = (3 * (z / r) ** 2 - 1) / 2
        return still.gravitational_parameter / r * (1 - still.j2 * (still.equatorial_radius / r) ** 2 * p2)

    north, down = gravity_ned(still, altitude, math.sin(latitude), math.cos(latitude))
    assert north == pytest.approx(float(mpmath.diff(lambda s: potential(s, 0), 0)), abs=1e-13)
    assert down == pytest.approx(-float(mpmath.diff(lambda s: potential(0, s), 0)), abs=1e-13)


def test_attraction_of_the_nasa_check_cases() -> None:
    # NASA/TM-2015-218675, atmospheric case 9, simulator 4 at 0 s: local gravitation 32.1988102141 ft/s2 on the equator,
    # the centrifugal part not in it
    still = WGS84._replace(rotation_rate=0.0)
    assert gravity_ned(still, 0.0, 0.0, 1.0)[1] / 0.3048 == pytest.approx(32.1988102141, abs=1e-9)


@pytest.mark.parametrize("factor", [-1.0, 0.0, 2.0])
def test_the_meridional_factor_scales_what_j2_pulls_along_the_meridian(factor: float) -> None:
    # On a still sphere geodetic and geocentric axes are one: there J2 alone pulls to the north or south.
    whole = Earth(6378137.0, 0.0, 3.986004418e14, 1.08262982e-3, 0.0)
    north, down = gravity_ned(whole, 2e4, math.sin(0.6), math.cos(0.6))
    scaled = gravity_ned(whole._replace(j2_meridional=factor), 2e4, math.sin(0.6), math.cos(0.6))
    assert north < -0.01
    assert scaled == pytest.approx((factor * north, down), abs=1e-14)
