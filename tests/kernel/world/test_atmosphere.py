"""U.S. Standard Atmosphere 1976 against its published table and its own equations."""

import math

import mpmath
import pytest
from hypothesis import given
from hypothesis import strategies as st

from abhv_mc.kernel.world import atmosphere as module
from abhv_mc.kernel.world.atmosphere import GAS_CONSTANT, GEOPOTENTIAL_RADIUS, atmosphere

# NOAA-S/T 76-1562, table I: geometric altitude m, kinetic temperature K, pressure Pa, density kg/m3, sound m/s
# (the printed digits; sound to 0.01).
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


@pytest.mark.parametrize("row", TABLE, ids=lambda row: f"{row[0]}m")
def test_published_table(row: tuple[float, ...]) -> None:
    altitude, temperature, pressure, density, sound = row
    got_density, got_pressure, got_temperature, got_sound = atmosphere(float(altitude))
    assert got_temperature == pytest.approx(temperature, abs=0.0006)
    assert got_pressure == pytest.approx(pressure, rel=5e-5)  # half of the fifth printed digit
    assert got_density == pytest.approx(density, rel=5e-5)
    assert got_sound == pytest.approx(sound, abs=0.006)


def test_layer_constants_follow_from_the_defining_ones() -> None:
    mpmath.mp.dps = 40
    hydrostatic = mpmath.mpf("9.80665") * mpmath.mpf("28.9644") / mpmath.mpf("8314.32")  # K/m
    lapse = [mpmath.mpf(text) / 1000 for text in ("-6.5", "0", "1", "2.8", "0", "-2.8", "-2", "0")]
    radius = mpmath.mpf(6356766)
    base = [mpmath.mpf(h) for h in (0, 11000, 20000, 32000, 47000, 51000, 71000)]
    base.append(radius * 86000 / (radius + 86000))
    temperature, pressure = mpmath.mpf("288.15"), mpmath.mpf(101325)
    for i, step in enumerate(lapse):
        rate = -hydrostatic / (step or temperature)
        assert module._BASE[i] == float(base[i])
        assert module._TEMPERATURE[i] == float(temperature)
        assert module._RELATIVE_LAPSE[i] == float(step / temperature)
        assert module._RATE[i] == float(rate)
        assert module._PRESSURE[i] == float(pressure)
        if i < 7:
            height = base[i + 1] - base[i]
            ratio = 1 + step / temperature * height
            pressure *= ratio**rate if step else mpmath.exp(rate * height)
            temperature *= ratio


@given(st.floats(-10e3, 300e3))
def test_gas_law_and_hydrostatic_balance_hold_everywhere(altitude: float) -> None:
    density, pressure, temperature, sound = atmosphere(altitude)
    assert pressure == pytest.approx(density * GAS_CONSTANT * temperature, rel=1e-14)
    assert sound == pytest.approx(math.sqrt(1.4 * pressure / density), rel=1e-14)
    step = 1.0
    slope = (atmosphere(altitude + step)[1] - atmosphere(altitude - step)[1]) / (2 * step)
    gravity = 9.80665 * (GEOPOTENTIAL_RADIUS / (GEOPOTENTIAL_RADIUS + altitude)) ** 2
    # second-order differences; a kink in the temperature costs a little more
    assert slope == pytest.approx(-density * gravity, rel=1e-5)


def test_not_a_number_passes_through() -> None:
    assert all(math.isnan(value) for value in atmosphere(math.nan))
