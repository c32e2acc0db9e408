"""The nominal air of a mission from CSV: wind and a factor on the standard density over altitude."""

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError

ALTITUDE = "altitude_m"
WIND = ("wind_north_mps", "wind_east_mps")  # that the air blows towards
DENSITY = ("density_factor",)
_MAX_ROWS = 500


def read_air_table(path: Path, columns: tuple[str, ...]) -> NDArray[np.float64]:
    """[knot, altitude and ``columns``] by rising altitude; other columns are left unread.

    Raises :class:`InputError` for anything but at least two rising altitudes and finite numbers, a factor on the
    density above zero.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, None, None, str(error), "a CSV file in UTF-8") from None
    header = [name.strip() for name in lines[0]] if lines else []
    wanted = (ALTITUDE, *columns)
    missing = [name for name in wanted if name not in header]
    if missing:
        raise InputError(path, 1, 1, f"no column {', '.join(missing)}", f"the columns {', '.join(wanted)}")
    places = [header.index(name) for name in wanted]
    rows: list[list[float]] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        row = [_number(path, number, line, place) for place in places]
        if rows and row[0] <= rows[-1][0]:
            raise InputError(path, number, places[0] + 1, f"the altitude {row[0]:g} m", "altitudes that rise")
        if columns == DENSITY and row[1] <= 0.0:
            raise InputError(path, number, places[1] + 1, f"a factor {row[1]:g}", "a factor above zero")
        rows.append(row)
    if not 2 <= len(rows) <= _MAX_ROWS:
        raise InputError(path, None, None, f"{len(rows)} rows", f"2 to {_MAX_ROWS}")
    return np.array(rows)


def _number(path: Path, number: int, line: list[str], place: int) -> float:
    text = line[place].strip() if place < len(line) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path, number, place + 1, f"'{text}'", "a finite number")
    return value


def join_air(wind: NDArray[np.float64] | None, density: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """The columns of :mod:`abhv_mc.plant.air_profile` on the altitudes of both tables, exact between them."""
    if wind is None and density is None:
        return np.empty((0, 4))
    knots = np.unique(np.concatenate([table[:, 0] for table in (wind, density) if table is not None]))
    still = np.zeros_like(knots)
    north, east = (np.interp(knots, wind[:, 0], wind[:, i]) for i in (1, 2)) if wind is not None else (still, still)
    factor = np.interp(knots, density[:, 0], density[:, 1]) if density is not None else still + 1.0
    return np.ascontiguousarray(np.stack([knots, north, east, factor], axis=1))
