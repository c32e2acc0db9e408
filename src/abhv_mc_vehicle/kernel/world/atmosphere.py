"""U.S. Standard Atmosphere 1976 up to 86 km, vectorized with one log and one exp.

The source is "U.S. Standard Atmosphere, 1976", NOAA-S/T 76-1562, part 1: defining constants (table
2), layers (table 4), pressure eqs. 33a and 33b, density eq. 42, speed of sound eq. 50. The
temperature is the molecular-scale temperature, which determines density and speed of sound; it
equals the kinetic temperature up to 80 km and exceeds it by 0.04 % at 86 km.
"""

import math
from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import exp, log, smaller

GEOPOTENTIAL_RADIUS = 6356766.0  # r0 in the geopotential altitude H = r0 Z / (r0 + Z), m
GAS_CONSTANT = 8314.32 / 28.9644  # R* / M0 with the standard's own R*, J/(kg K)
HEAT_CAPACITY_RATIO = 1.4

# Columns: geopotential base height, m; base temperature, K; relative lapse rate, 1/m; rate; base
# pressure, Pa. The relative lapse rate is divided by the base temperature.
# In layers with a lapse rate, log(p / p_base) = rate log(T / T_base), rate = -g0 M0 / (R* lapse).
# In isothermal layers, log(p / p_base) = rate (height above base), rate = -g0 M0 / (R* T), 1/m.
# Lapse rates are -6.5, 0, 1, 2.8, 0, -2.8, -2, 0 K/km; above 86 km the temperature is constant.
_LAYERS = (
    (0.0, 288.15, -2.2557695644629534e-05, 5.255876113278518, 101325.0),
    (11000.0, 216.65, 0.0, -0.00015768841327629986, 22632.06397346293),
    (20000.0, 216.65, 4.615739672282483e-06, -34.163194736310366, 5474.88866967778),
    (32000.0, 228.65, 1.2245790509512356e-05, -12.201140977253703, 868.0186847552274),
    (47000.0, 270.65, 0.0, -0.0001262264723307237, 110.90630555496588),
    (51000.0, 270.65, -1.0345464622205801e-05, 12.201140977253703, 66.93887311868727),
    (71000.0, 214.65, -9.317493594223155e-06, 17.081597368155183, 3.9564204280407287),
    (84852.04584490575, 186.9459083101885, 0.0, -0.00018274374146571507, 0.3733804618310579),
)
_BASE, _TEMPERATURE, _RELATIVE_LAPSE, _RATE, _PRESSURE = zip(*_LAYERS, strict=True)


class Layer(NamedTuple):
    """Layer of the standard atmosphere."""

    base: float  # geopotential height of the base, m
    top: float
    temperature: float  # temperature at the base, K
    relative_lapse: float  # lapse rate divided by the base temperature, 1/m
    rate: float
    pressure: float  # pressure at the base, Pa


@scalar
def geopotential_height(altitude: float) -> float:
    """Return the geopotential height, m, of a geometric altitude, m."""
    return GEOPOTENTIAL_RADIUS * altitude / (GEOPOTENTIAL_RADIUS + altitude)


@scalar
def layer_at(height: float) -> Layer:
    """Return the layer at a geopotential height (m); below 0 m and for NaN, the lowest one."""
    base = _BASE[0]
    top = _BASE[1]
    base_temperature = _TEMPERATURE[0]
    relative_lapse = _RELATIVE_LAPSE[0]
    rate = _RATE[0]
    base_pressure = _PRESSURE[0]
    for i in range(1, 8):
        above = height >= _BASE[i]
        base = _BASE[i] if above else base
        top = (_BASE[i + 1] if i < 7 else math.inf) if above else top
        base_temperature = _TEMPERATURE[i] if above else base_temperature
        relative_lapse = _RELATIVE_LAPSE[i] if above else relative_lapse
        rate = _RATE[i] if above else rate
        base_pressure = _PRESSURE[i] if above else base_pressure
    return Layer(base, top, base_temperature, relative_lapse, rate, base_pressure)


@scalar
def air_in_layer(
    layer: Layer, height: float, isothermal: bool
) -> tuple[float, float, float, float]:
    """Return density, pressure, temperature and 1 / speed of sound.

    ``isothermal`` avoids the logarithm; it may be False for any layer.
    """
    above_base = height - layer.base
    ratio = 1.0 if isothermal else 1.0 + layer.relative_lapse * above_base
    temperature = layer.temperature * ratio
    along = (
        above_base if isothermal else (log(ratio) if layer.relative_lapse != 0.0 else above_base)
    )
    pressure = layer.pressure * exp(layer.rate * along)
    per_sound_speed = 1.0 / math.sqrt((HEAT_CAPACITY_RATIO * GAS_CONSTANT) * temperature)
    # density from p / (R T)
    density = pressure * (HEAT_CAPACITY_RATIO * (per_sound_speed * per_sound_speed))
    return density, pressure, temperature, per_sound_speed


@scalar
def atmosphere(altitude: float) -> tuple[float, float, float, float]:
    """Return (density kg/m3, pressure Pa, temperature K, speed of sound m/s).

    The altitude is geometric, in m. Below 0 m the lowest layer continues; above 86 km the air is
    isothermal. The result is NaN for NaN.
    """
    height = geopotential_height(altitude)
    density, pressure, temperature, per_sound_speed = air_in_layer(layer_at(height), height, False)
    return density, pressure, temperature, 1.0 / per_sound_speed


@scalar
def warm_pressure(altitude: float, offset: float) -> float:
    """Return the pressure at an altitude (m), divided by the standard pressure.

    The air is in hydrostatic balance, ``offset`` (K) warmer than the standard atmosphere at every
    altitude, and has the standard pressure at 0 m.
    """
    height = geopotential_height(altitude)
    power = 0.0
    for i in range(8):
        depth = height - _BASE[i]
        depth = depth if depth > 0.0 or i == 0 else 0.0
        if i < 7:
            depth = smaller(depth, _BASE[i + 1] - _BASE[i])
        share = _TEMPERATURE[i] / (_TEMPERATURE[i] + offset)
        lapse = _RELATIVE_LAPSE[i] * depth
        if _RELATIVE_LAPSE[i] == 0.0:
            power += _RATE[i] * depth * (share - 1.0)
        else:
            power += _RATE[i] * (log(1.0 + lapse * share) - log(1.0 + lapse))
    return exp(power)


@lanes
def atmosphere_lanes(Z, width, altitude_row, density_row, per_sound_row):
    """Compute density and 1 / speed of sound in every lane.

    Flights of a campaign are mostly in the same layer. In this case the layer's numbers are
    scalars, and an isothermal layer needs no logarithm.
    """
    for lane in range(width):
        Z[density_row, lane] = geopotential_height(Z[altitude_row, lane])
    layer = layer_at(Z[density_row, 0])
    elsewhere = 0
    for lane in range(width):
        height = Z[density_row, lane]
        elsewhere += 0 if layer.base <= height < layer.top else 1
    if elsewhere > 0:
        for lane in range(width):
            height = Z[density_row, lane]
            Z[density_row, lane], _, _, Z[per_sound_row, lane] = air_in_layer(
                layer_at(height), height, False
            )
    elif layer.relative_lapse == 0.0:
        for lane in range(width):
            Z[density_row, lane], _, _, Z[per_sound_row, lane] = air_in_layer(
                layer, Z[density_row, lane], True
            )
    else:
        for lane in range(width):
            Z[density_row, lane], _, _, Z[per_sound_row, lane] = air_in_layer(
                layer, Z[density_row, lane], False
            )
