"""A recorded trajectory: a CSV file with the columns time_s, altitude_m, speed_mps, heading_deg."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.control.csv_columns import read_columns
from abhv_mc.io.input_error import InputError
from abhv_mc.io.units import LENGTH, SPEED, TIME

COLUMNS = ("time_s", "altitude_m", "speed_mps", "heading_deg")
_LARGEST = (TIME.largest, LENGTH.largest, SPEED.largest, 1e4)


def read_trajectory(path: str | Path, duration: float) -> NDArray[np.float64]:
    """[sample, column] in COLUMNS' order and units, headings unwrapped; other columns are left unread.

    Raises :class:`InputError` for anything but rising times from 0 to at least ``duration`` (s), finite numbers,
    positive speeds and four samples.
    """
    path = Path(path)
    samples: list[list[float]] = []
    for number, places, sample in read_columns(path, dict(zip(COLUMNS, _LARGEST, strict=True))):
        if samples and sample[0] <= samples[-1][0]:
            raise InputError(path, number, places[0], f"the time {sample[0]:g} s", "times that rise")
        if sample[2] <= 0.0:
            raise InputError(path, number, places[2], f"the speed {sample[2]:g} m/s", "a positive one")
        samples.append(sample)
    if len(samples) < 4:
        raise InputError(path, None, None, f"{len(samples)} samples", "at least 4")
    if abs(samples[0][0]) > 1e-9 or samples[-1][0] < duration - 1e-9:
        raise InputError(
            path, None, None, f"times {samples[0][0]:g}..{samples[-1][0]:g} s", f"times from 0 to {duration:g} s"
        )
    result = np.array(samples)
    result[:, 3] = np.rad2deg(np.unwrap(np.deg2rad(result[:, 3])))
    return result
