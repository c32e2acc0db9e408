"""Standard atmosphere, gravity and turbulence against published numbers and their equations."""

import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.world import atmosphere as module
from abhv_mc_vehicle.kernel.world.atmosphere import GAS_CONSTANT, GEOPOTENTIAL_RADIUS, atmosphere
from abhv_mc_vehicle.kernel.world.earth import (
    WGS84,
    Earth,
    find_surroundings,
    gravity_ned,
    radii,
    standard_air,
)
from abhv_mc_vehicle.kernel.world.turbulence import (
    dryden_first,
    dryden_second,
    dryden_second_output,
    one_minus_cosine,
)

# NOAA-S/T 76-1562, table I: geometric altitude m, kinetic temperature K, pressure Pa, density
# kg/m3, sound m/s (the printed digits; sound to 0.01).
TABLE = [
    (0, 288.150, 1.01325e5, 1.2250e0, 340.29),
    (1000, 281.651, 8.9876e4, 1.1117e0, 336.43),
    (5000, 255.676, 5.4048e4, 7.3643e-1, 320.55),
    (10000, 223.252, 2.6500e4, 4.1351e-1, 299.53),
    (15000, 216.650, 1.2112e4, 1.9476e-1, 295.07),
    (20000, 216.650, 5.5293e3, 8.8910e-2, 295.07),
    (25000, 221.552, 2.5492e3, 4.0084e-2, 298.39),
    (30000, 226.509, 1.1970e3, 1.8410e-2, 301.71),
    (40000, 250.350, 2.8714e2, 3.9957e-3, 317.19),
    (50000, 270.650, 7.9779e1, 1.0269e-3, 329.80),
    (60000, 247.021, 2.1959e1, 3.0968e-4, 315.07),
    (70000, 219.585, 5.2209e0, 8.2829e-5, 297.06),
    (80000, 198.639, 1.0525e0, 1.8458e-5, 282.54),
]


def test_published_table():
    for altitude, temperature, pressure, density, sound in TABLE:
        got_density, got_pressure, got_temperature, got_sound = atmosphere(float(altitude))
        assert got_temperature == pytest.approx(temperature, abs=0.0006), altitude
        assert got_pressure == pytest.approx(pressure, rel=5e-5), (
            altitude
        )  # half of the fifth printed digit
        assert got_density == pytest.approx(density, rel=5e-5), altitude
        assert got_sound == pytest.approx(sound, abs=0.006), altitude


def test_layer_constants_follow_from_the_defining_ones():
    mpmath.mp.dps = 40
    hydrostatic = mpmath.mpf("9.80665") * mpmath.mpf("28.9644") / mpmath.mpf("8314.32")  # K/m
    lapse = [mpmath.mpf(text) / 1000 for text in ("-6.5", "0", "1", "2.8", "0", "-2.8", "-2", "0")]
    radius = mpmath.mpf(6356766)
    base = [mpmath.mpf(h) for h in (0, 11000, 20000, 32000, 47000, 51000, 71000)]
    base.append(radius * 86000 / (radius + 86000))
    temperature, pressure = mpmath.mpf("288.15"), mpmath.mpf(101325)
    for i, step in enumerate(lapse):
        rate = -hydrostatic / (step or temperature)
        assert module._LAYERS[i] == tuple(
            map(float, (base[i], temperature, step / temperature, rate, pressure))
        )
        if i < 7:
            height = base[i + 1] - base[i]
            ratio = 1 + step / temperature * height
            pressure *= ratio**rate if step else mpmath.exp(rate * height)
            temperature *= ratio


@given(st.floats(-10e3, 300e3))
def test_gas_law_and_hydrostatic_balance_hold_everywhere(altitude):
    density, pressure, temperature, sound = atmosphere(altitude)
    assert pressure == pytest.approx(density * GAS_CONSTANT * temperature, rel=1e-14)
    assert sound == pytest.approx(math.sqrt(1.4 * pressure / density), rel=1e-14)
    step = 1.0
    slope = (atmosphere(altitude + step)[1] - atmosphere(altitude - step)[1]) / (2 * step)
    gravity = 9.80665 * (GEOPOTENTIAL_RADIUS / (GEOPOTENTIAL_RADIUS + altitude)) ** 2
    # second-order differences; a kink in the temperature costs a little more
    assert slope == pytest.approx(-density * gravity, rel=1e-5)


def test_not_a_number_passes_through():
    assert all(math.isnan(value) for value in atmosphere(math.nan))


def test_surroundings_equal_the_scalar_functions_bit_for_bit():
    altitude, latitude = np.linspace(-1e3, 120e3, 90), np.linspace(-1.5, 1.5, 90)
    sine, cosine = np.sin(latitude), np.cos(latitude)
    surroundings = np.stack(find_surroundings(WGS84, altitude, sine, cosine), axis=1)
    for i, (height, sin_lat, cos_lat) in enumerate(zip(altitude, sine, cosine, strict=True)):
        density, _, _, sound = atmosphere(height)
        gravity = gravity_ned(WGS84, height, sin_lat, cos_lat)
        expected = (density, sound, *gravity, *radii(WGS84, sin_lat))
        assert tuple(surroundings[i]) == expected
        assert tuple(find_surroundings(WGS84, height, sin_lat, cos_lat)) == expected
        assert standard_air(height) == (density, sound)


def test_wgs84_radii_of_curvature():
    # NIMA TR8350.2 (3rd ed.): semi-minor axis 6356752.3142 m, polar radius of curvature
    # 6399593.6258 m
    meridian, prime_vertical = radii(WGS84, 0.0)
    assert prime_vertical == 6378137.0
    assert meridian == pytest.approx(6356752.3142**2 / 6378137.0, abs=1e-3)
    assert radii(WGS84, 1.0) == pytest.approx((6399593.6258, 6399593.6258), abs=1e-4)


def test_wgs84_gravity_is_normal_gravity_but_for_the_higher_zonals():
    # NIMA TR8350.2: normal gravity 9.7803253359 m/s2 at the equator, 9.8321849378 m/s2 at the
    # poles. J4 alone accounts for the difference: 5 GM/a2 (a/r)^6 J4 P4 with J4 = -2.37e-6.
    zonal_4 = -2.37091222e-6
    equator_north, equator = gravity_ned(WGS84, 0.0, 0.0, 1.0)
    pole_north, pole = gravity_ned(WGS84, 0.0, 1.0, 0.0)
    mean = 3.986004418e14 / 6378137.0**2
    b_over_a = 1 - WGS84.flattening
    assert equator - 5 * mean * zonal_4 * 3 / 8 == pytest.approx(9.7803253359, abs=5e-7)
    assert pole - 5 * mean * zonal_4 / b_over_a**6 == pytest.approx(9.8321849378, abs=5e-7)
    assert (equator_north, pole_north) == pytest.approx((0.0, 0.0), abs=1e-15)


@pytest.mark.parametrize("latitude", [-1.2, 0.3, 0.8, 1.5])
def test_gravity_is_the_gradient_of_the_potential(latitude):
    """The potential includes attraction and rotation."""
    mpmath.mp.dps = 40
    altitude = 20000.0
    sine, cosine = mpmath.sin(latitude), mpmath.cos(latitude)
    _, n = radii(WGS84, math.sin(latitude))
    e2 = WGS84.flattening * (2 - WGS84.flattening)

    def potential(north, up):
        rho = (n + altitude) * cosine - north * sine + up * cosine
        z = (n * (1 - e2) + altitude) * sine + north * cosine + up * sine
        r = mpmath.sqrt(rho**2 + z**2)
        p2 = (3 * (z / r) ** 2 - 1) / 2
        attraction = (
            WGS84.gravitational_parameter
            / r
            * (1 - WGS84.j2 * (WGS84.equatorial_radius / r) ** 2 * p2)
        )
        return attraction + (WGS84.rotation_rate * rho) ** 2 / 2

    north, down = gravity_ned(WGS84, altitude, math.sin(latitude), math.cos(latitude))
    assert north == pytest.approx(float(mpmath.diff(lambda s: potential(s, 0), 0)), abs=1e-13)
    assert down == pytest.approx(-float(mpmath.diff(lambda s: potential(0, s), 0)), abs=1e-13)


def test_attraction_of_the_nasa_check_cases():
    # NASA/TM-2015-218675, atmospheric case 9, simulator 4 at 0 s: local gravitation 32.1988102141
    # ft/s2 on the equator, the centrifugal part not in it
    fixed_earth = WGS84._replace(rotation_rate=0.0)
    assert gravity_ned(fixed_earth, 0.0, 0.0, 1.0)[1] / 0.3048 == pytest.approx(
        32.1988102141, abs=1e-9
    )


@pytest.mark.parametrize("factor", [-1.0, 0.0, 2.0])
def test_the_meridional_factor_scales_the_north_component_of_j2(factor):
    # On a non-rotating sphere geodetic and geocentric axes coincide, so only J2 has a north
    # component.
    earth = Earth(6378137.0, 0.0, 3.986004418e14, 1.08262982e-3, 0.0)
    north, down = gravity_ned(earth, 2e4, math.sin(0.6), math.cos(0.6))
    scaled = gravity_ned(earth._replace(j2_meridional=factor), 2e4, math.sin(0.6), math.cos(0.6))
    assert north < -0.01
    assert scaled == pytest.approx((factor * north, down), abs=1e-14)


V, L, DT = 1400.0, 533.4, 0.01
A = V / L


@kernel
def _simulate(noise, a, dt):
    n = noise.shape[0]
    out = np.empty((n, 2))
    u, x1, x2 = 0.0, 0.0, 0.0
    for i in range(n):
        u = dryden_first(u, a, dt, noise[i, 0]) if i > 0 else noise[0, 0]
        x1, x2 = dryden_second(x1, x2, a, dt, noise[i, 1], noise[i, 2], i == 0)
        out[i, 0], out[i, 1] = u, dryden_second_output(x1, x2, a)
    return out


def test_turbulence_has_drydens_spectra_and_unit_variance():
    """Compare with the spectra of MIL-F-8785C, 3.7.1.2.

    One-sided, well below the sampling rate; averaged in bands, within 10 %.
    """
    gusts = _simulate(np.random.default_rng(8785).standard_normal((400_000, 3)), A, DT)
    assert gusts.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.03)
    frequency, power = signal.welch(gusts, fs=1.0 / DT, nperseg=8192, axis=0)
    x = 2.0 * np.pi * frequency / A
    longitudinal = 4.0 / A / (1.0 + x**2)
    lateral = 2.0 / A * (1.0 + 3.0 * x**2) / (1.0 + x**2) ** 2
    for low, high in [(0.05, 0.2), (0.2, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 5.0)]:
        band = (frequency > low) & (frequency < high)
        expected = longitudinal[band].mean(), lateral[band].mean()
        assert power[band].mean(axis=0) == pytest.approx(expected, rel=0.1)


def test_turbulence_has_its_variance_from_the_start_and_at_any_step():
    draws = np.random.default_rng(3).standard_normal((20_000, 2)).tolist()
    starts = [
        dryden_second_output(*dryden_second(0.0, 0.0, A, DT, *noise, True), A) for noise in draws
    ]
    assert np.std(starts) == pytest.approx(1.0, rel=0.02)
    noise = np.random.default_rng(5).standard_normal((60_000, 3))
    for dt in (0.001, 0.1, 0.5):
        assert _simulate(noise, A, dt).std(axis=0) == pytest.approx([1.0, 1.0], rel=0.12)


def test_one_minus_cosine():
    assert [
        one_minus_cosine(x, 1000.0) for x in (-50.0, 0.0, 500.0, 1000.0, 5000.0)
    ] == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0], abs=1e-12)
    assert one_minus_cosine(250.0, 1000.0) == pytest.approx(
        0.5 * (1.0 - np.cos(np.pi / 4.0)), abs=1e-14
    )
