"""A recorded trajectory: a CSV file with the columns time_s, altitude_m, speed_mps, heading_deg."""

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError

COLUMNS = ("time_s", "altitude_m", "speed_mps", "heading_deg")
_MAX_BYTES = 20_000_000


def read_trajectory(path: str | Path, duration: float) -> NDArray[np.float64]:
    """[sample, column] in COLUMNS' order and units, headings unwrapped; other columns are left unread.

    Raises :class:`InputError` for anything but rising times from 0 to at least ``duration`` (s), finite numbers,
    positive speeds and four samples.
    """
    path = Path(path)
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(path, None, None, "a very large file", f"at most {_MAX_BYTES // 1_000_000} MB")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, None, None, str(error), "a CSV file in UTF-8") from None
    header = [name.strip() for name in lines[0]] if lines else []
    missing = [name for name in COLUMNS if name not in header]
    if missing:
        raise InputError(path, 1, 1, f"no column {', '.join(missing)}", f"the columns {', '.join(COLUMNS)}")
    places = [header.index(name) for name in COLUMNS]
    samples: list[list[float]] = []
    for number, line in enumerate(lines[1:], start=2):
        if not line:
            continue
        sample = [_number(path, number, line, place) for place in places]
        if samples and sample[0] <= samples[-1][0]:
            raise InputError(path, number, places[0] + 1, f"the time {sample[0]:g} s", "times that rise")
        if sample[2] <= 0.0:
            raise InputError(path, number, places[2] + 1, f"the speed {sample[2]:g} m/s", "a positive one")
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


def _number(path: Path, number: int, line: list[str], place: int) -> float:
    text = line[place].strip() if place < len(line) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path, number, place + 1, f"'{text}'", "a finite number")
    return value
