"""A recorded trajectory: a CSV file with the columns time_s, altitude_m, speed_mps, heading_deg."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError
from abhv_mc.io.number_table import read_number_table
from abhv_mc.io.units import LENGTH, SPEED, TIME

COLUMNS = ("time_s", "altitude_m", "speed_mps", "heading_deg")
_LARGEST = dict(zip(COLUMNS, (TIME.largest, LENGTH.largest, SPEED.largest, 1e4), strict=True))
_MAX_BYTES = 20_000_000


def read_trajectory(path: str | Path, duration: float) -> NDArray[np.float64]:
    """[sample, column] in COLUMNS' order and units, headings unwrapped; other columns are left unread.

    Raises :class:`InputError` for anything but rising times from 0 to at least ``duration`` (s), finite numbers,
    positive speeds and four samples.
    """
    table = read_number_table(Path(path), _LARGEST, _MAX_BYTES)
    samples = table.values
    table.check_rising("time_s", "s")
    for row in np.flatnonzero(samples[:, 2] <= 0.0)[:1]:
        raise table.error(int(row), "speed_mps", f"the speed {samples[row, 2]:g} m/s", "a positive one")
    if len(samples) < 4:
        raise InputError(table.path, f"{len(samples)} samples", "at least 4")
    first, last = samples[0, 0], samples[-1, 0]
    if abs(first) > 1e-9 or last < duration - 1e-9:
        raise InputError(table.path, f"times {first:g}..{last:g} s", f"times from 0 to {duration:g} s")
    samples[:, 3] = np.rad2deg(np.unwrap(np.deg2rad(samples[:, 3])))
    return samples
