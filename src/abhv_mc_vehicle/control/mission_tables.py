"""Functions to read a mission's CSV tables: recorded trajectory and nominal air."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.foreign_table import (
    Column,
    ForeignTable,
    read_foreign_table,
    read_numbers,
    take_numbers,
)
from abhv_mc.io.messages import InputError, counted, grouped_digits, one_of
from abhv_mc.io.units import ANGLE, DENSITY, FRACTION, KELVIN, LENGTH, PRESSURE, SPEED, TIME
from abhv_mc_vehicle.kernel.world.atmosphere import GAS_CONSTANT, atmosphere, geopotential_height

_TRAJECTORY = {"time": TIME, "altitude": LENGTH, "speed": SPEED, "heading": ANGLE}

_G0 = 9.80665  # standard gravity, m/s2
# smallest height (m) and departure of the pressure per km that are a warning
_BALANCED_OVER = 2000.0
_IMBALANCE = 0.05


def read_trajectory(path: str | Path, duration: float) -> Floats:
    """Return time, altitude, speed and unwrapped heading [sample, column].

    Raise InputError if the table is invalid or shorter than ``duration`` (s).
    """
    table = read_numbers(Path(path), _TRAJECTORY)
    samples = table.values
    table.check_rising("time", "s")
    for row in np.flatnonzero(samples[:, 2] <= 0.0)[:1]:
        raise table.error(
            int(row), "speed", f"the speed is {samples[row, 2]:g} m/s", "a positive speed"
        )
    if len(samples) < 4:
        raise InputError(path, f"found {counted(len(samples), 'sample')}", "at least 4 samples")
    first = samples[0, 0]
    last = samples[-1, 0]
    if abs(first) > 1e-9 or last < duration - 1e-9:
        raise InputError(
            path, f"the times range from {first:g} to {last:g} s", f"times from 0 to {duration:g} s"
        )
    samples[:, 3] = np.unwrap(samples[:, 3])
    return samples


AIR = {
    "wind_north": SPEED,  # velocity of the air towards north
    "wind_east": SPEED,
    "wind_speed": SPEED,
    "wind_direction": ANGLE,  # direction from which the wind blows, measured clockwise from north
    "density_factor": FRACTION,  # density relative to the standard atmosphere
    "density": DENSITY,
    "pressure": PRESSURE,
    "temperature": FRACTION,  # temperature in K; see KELVIN
}
_ENSEMBLE = "member", "weight"
WIND = ("wind_north", "wind_east"), ("wind_speed", "wind_direction")
DENSITIES = ("density_factor",), ("density",), ("pressure", "temperature")
_MAX_ROWS = 10_000
_HIGHEST = 1e6  # largest plausible altitude of a table, m; larger values indicate a wrong unit


def read_air_table(
    path: Path, choices: Sequence[tuple[str, ...]], heads: Mapping[str, str], comma: str = ""
) -> Floats:
    """Return the altitude and the first available choice of columns [level, column].

    ``comma`` is the meaning of commas in numbers. Altitudes may increase or decrease in the file;
    they increase in the result. Wind is the air's velocity towards north and east. Density is a
    factor on the standard density, followed by a factor on the standard temperature if the table
    contains temperatures. Raise InputError if the table is invalid.
    """
    air = _take_air(read_foreign_table(path, comma=comma), choices, heads)
    if air is None:
        expected = ", or ".join(" and ".join(choice) for choice in choices)
        raise InputError(path, "the required columns are missing", f"the columns {expected}", 1)
    return air


def _take_air(
    table: ForeignTable, choices: Sequence[tuple[str, ...]], heads: Mapping[str, str]
) -> Floats | None:
    """Return the result of :func:`read_air_table`, or None if columns are missing."""
    columns = table.find(("altitude", *_ENSEMBLE, *AIR), heads)
    for index, head in enumerate(table.heads):
        stem, _, unit = head.rpartition("_")
        if stem == "temperature" and unit in KELVIN:
            columns.setdefault(stem, Column(index, unit))
    for name, head in heads.items():
        if name not in columns:
            raise table.error(
                None, None, f"the table has no column '{head}'", f"the header of the {name} column"
            )
    names = next((names for names in choices if set(names) <= columns.keys()), None)
    if names is None:
        return None
    if names in DENSITIES[:2] and "temperature" in columns:
        names = (*names, "temperature")
    factor = 1.0
    offset = 0.0
    if "temperature" in names:
        column = columns["temperature"]
        if column.unit not in KELVIN:
            raise table.error(
                None,
                column.position,
                f"the temperature has the unit '{column.unit}'",
                one_of(KELVIN),
            )
        factor, offset = KELVIN[column.unit]
        columns["temperature"] = column._replace(unit="")
    dimensions = {"altitude": LENGTH, **{name: AIR[name] for name in names}}
    numbers = take_numbers(table, columns, dimensions)
    numbers.check_rising("altitude", "m", or_falling=True)
    altitude, *values = numbers.values.T
    if not 2 <= len(altitude) <= _MAX_ROWS:
        raise InputError(
            table.path,
            f"found {counted(len(altitude), 'row')}",
            f"2 to {grouped_digits(_MAX_ROWS)} rows",
        )
    standard = np.array([atmosphere(height) for height in altitude.tolist()])
    if "temperature" in names:
        kelvin = values[1] * factor + offset
        for row in np.flatnonzero(kelvin <= 0.0)[:1]:
            raise numbers.error(
                int(row),
                "temperature",
                f"the temperature is {kelvin[row]:g} K",
                "a temperature above 0 K",
            )
        values[1] = kelvin / standard[:, 2]
        if names in DENSITIES:
            values[0] = values[0] / (GAS_CONSTANT * kelvin)
    if names == WIND[1]:
        values = [-values[0] * np.cos(values[1]), -values[0] * np.sin(values[1])]
    elif names not in WIND:
        if names[0] != "density_factor":
            values[0] = values[0] / standard[:, 0]
        for row in np.flatnonzero((values[0] <= 0.0) | ~np.isfinite(values[0]))[:1]:
            raise numbers.error(
                int(row),
                names[0],
                f"the density is {values[0][row]:g} times that of the standard atmosphere",
                "a factor above zero",
            )
    order = np.argsort(altitude)
    return np.column_stack([altitude, *values])[order]


def read_ensemble(
    path: Path, heads: Mapping[str, str], comma: str = ""
) -> tuple[list[Floats], Floats]:
    """Return the air [level, column] and the weight of each member, in the order of the file.

    Raise InputError if the table is invalid.
    """
    table = read_foreign_table(path, comma=comma)
    columns = table.find(_ENSEMBLE, heads)
    if "member" not in columns:
        raise table.error(None, None, "the table has no column 'member'", "a column 'member'")
    names = np.array(table.words(columns["member"].position))
    weights = []
    members = list[Floats]()
    for name in dict.fromkeys(names.tolist()):
        rows = np.flatnonzero(names == name).tolist()
        own = replace(
            table,
            data=table.data.take(rows),
            lines=[table.lines[row] for row in rows],
        )
        wind, density = (_take_air(own, choices, heads) for choices in (WIND, DENSITIES))
        members.append(join_air(wind, density))
        if not len(members[-1]):
            raise table.error(
                None,
                None,
                "the required columns are missing",
                "columns of wind, of density, or of pressure and temperature",
            )
        weight = own.numbers([columns["weight"].position]) if "weight" in columns else np.ones(1)
        if not weight.min() == weight.max() > 0.0:
            raise table.error(
                rows[0],
                columns["weight"].position,
                f"member '{name}' has the weights {weight.min():g} to {weight.max():g}",
                "a positive weight",
            )
        weights.append(float(weight.flat[0]))
    if len(members) < 2:
        raise table.error(None, None, f"found {counted(len(members), 'member')}", "at least 2")
    return members, np.array(weights)


def find_air_warnings(path: Path, table: Floats, altitude: Floats) -> list[str]:
    """Return a warning unless a table [level, column] covers a flight's altitudes."""
    low, high, lowest, highest = *table[[0, -1], 0], altitude.min(), altitude.max()
    if low <= lowest and highest <= high <= _HIGHEST:
        return []
    hint = ""
    for unit, factor in (("km", 1e3), ("ft", 0.3048), ("m", 1e-3)):
        if low * factor <= lowest and highest <= high * factor <= _HIGHEST:
            hint = f"; are its altitudes in {unit}?"
            break
    return [
        f"'{path.name}' has levels from {low:g} to {high:g} m, but the flight is at altitudes from "
        f"{lowest:.0f} to {highest:.0f} m; outside the table, its nearest level is used{hint}"
    ]


def find_imbalance(air: Floats) -> list[str]:
    """Return a warning if nominal air [level, column] is not in hydrostatic balance.

    The logarithm of the pressure, relative to the standard one, is compared with the integral of
    (1 / T_standard - 1 / T) g / R over the geopotential height.
    """
    height = np.array([geopotential_height(z) for z in air[:, 0].tolist()])
    standard = np.array([atmosphere(z)[2] for z in air[:, 0].tolist()])
    slope = (1.0 / standard - 1.0 / (standard * air[:, 4])) * _G0 / GAS_CONSTANT
    balance = np.append(0.0, np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(height)))
    departure = np.log(air[:, 3] * air[:, 4]) - balance
    tops = np.searchsorted(height, height + _BALANCED_OVER)
    for low, top in enumerate(tops[tops < len(height)]):
        rate = 1e3 * (departure[top] - departure[low]) / (height[top] - height[low])
        if abs(rate) > _IMBALANCE:
            return [
                f"the air from {air[low, 0]:g} to {air[top, 0]:g} m is not in hydrostatic balance: "
                f"the pressure departs by {rate:+.1%} per km"
            ]
    return []


def join_air(wind: Floats | None, density: Floats | None) -> Floats:
    """Merge the wind and density tables into the nominal air at the altitudes of both tables.

    The columns are those of :mod:`abhv_mc_vehicle.kernel.plant.air_data`.
    """
    tables = [table for table in (wind, density) if table is not None]
    if not tables:
        return np.empty((0, 5))
    knots = np.unique(np.concatenate([table[:, 0] for table in tables]))
    air = np.ones((5, knots.size))
    air[0] = knots
    air[1:3] = 0.0
    for first, table in ((1, wind), (3, density)):
        if table is not None:
            for row, column in enumerate(table.T[1:], first):
                air[row] = np.interp(knots, table[:, 0], column)
    return np.ascontiguousarray(air.T)
