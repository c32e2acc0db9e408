"""The CSV tables that a mission names: a recorded trajectory, and the nominal air over altitude."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError
from abhv_mc.io.number_table import read_number_table
from abhv_mc.io.units import LENGTH, SPEED, TIME

COLUMNS = ("time_s", "altitude_m", "speed_mps", "heading_deg")
_LARGEST_FLOWN = dict(zip(COLUMNS, (TIME.largest, LENGTH.largest, SPEED.largest, 1e4), strict=True))


def read_trajectory(path: str | Path, duration: float) -> NDArray[np.float64]:
    """[sample, column] in COLUMNS' order and units, headings unwrapped; at least ``duration`` s. Raises InputError."""
    table = read_number_table(Path(path), _LARGEST_FLOWN)
    samples = table.values
    table.check_rising("time_s", "s")
    for row in np.flatnonzero(samples[:, 2] <= 0.0)[:1]:
        raise table.error(
            int(row), "speed_mps", f"the speed {samples[row, 2]:g} m/s", "a positive one"
        )
    if len(samples) < 4:
        raise InputError(path, f"{len(samples)} samples", "at least 4")
    first, last = samples[0, 0], samples[-1, 0]
    if abs(first) > 1e-9 or last < duration - 1e-9:
        raise InputError(path, f"times {first:g}..{last:g} s", f"times from 0 to {duration:g} s")
    samples[:, 3] = np.rad2deg(np.unwrap(np.deg2rad(samples[:, 3])))
    return samples


ALTITUDE = "altitude_m"
WIND = ("wind_north_mps", "wind_east_mps")  # that the air blows towards
DENSITY = ("density_factor",)
_MAX_ROWS = 500
_LARGEST = {ALTITUDE: LENGTH.largest, **dict.fromkeys(WIND, SPEED.largest), DENSITY[0]: 1e3}


def read_air_table(path: Path, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """[knot, altitude and ``columns``] by rising altitude. Raises :class:`InputError`."""
    table = read_number_table(path, {name: _LARGEST[name] for name in (ALTITUDE, *columns)})
    table.check_rising(ALTITUDE, "m")
    rows = table.values
    if columns == DENSITY:
        for row in np.flatnonzero(rows[:, 1] <= 0.0)[:1]:
            raise table.error(
                int(row), DENSITY[0], f"a factor {rows[row, 1]:g}", "a factor above zero"
            )
    if not 2 <= len(rows) <= _MAX_ROWS:
        raise InputError(path, f"{len(rows)} rows", f"2 to {_MAX_ROWS}")
    return rows


def join_air(
    wind: NDArray[np.float64] | None, density: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """The columns of :mod:`abhv_mc.kernel.plant.air_data` on the altitudes of both tables, exact between them."""
    if wind is None and density is None:
        return np.empty((0, 4))
    knots = np.unique(
        np.concatenate([table[:, 0] for table in (wind, density) if table is not None])
    )
    still = np.zeros_like(knots)
    north, east = (
        (np.interp(knots, wind[:, 0], wind[:, i]) for i in (1, 2))
        if wind is not None
        else (still, still)
    )
    factor = np.interp(knots, density[:, 0], density[:, 1]) if density is not None else still + 1.0
    return np.ascontiguousarray(np.stack([knots, north, east, factor], axis=1))
