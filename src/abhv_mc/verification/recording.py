"""Other people's time histories: CSV files, plain or compressed, read column by column."""

import csv
import gzip
import io
import math
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from abhv_mc.io.input_error import InputError
from abhv_mc.vehicle.arrays import Floats

_MOST_BYTES = 200_000_000
_EVEN = 0.02  # of the spacing: printed times are rounded


def read_columns(path: Path, names: Iterable[str]) -> dict[str, Floats]:
    """The named columns ``[row]`` of a ``.csv`` or ``.csv.gz`` file; others are left unread.

    Raises :class:`InputError` for a missing column, a cell that is no finite number, or fewer than two rows.
    """
    names = list(names)
    reader = csv.reader(io.StringIO(_read_text(path)))
    try:
        header = [name.strip() for name in next(reader, [])]
        lines = [(reader.line_num, cells) for cells in reader if cells]
    except csv.Error as error:
        raise InputError(path, reader.line_num, None, str(error), "a CSV file") from None
    missing = [name for name in names if name not in header]
    if missing:
        raise InputError(path, 1, None, f"no column {', '.join(missing)}", "it: the comparison needs it")
    for name in names:
        if header.count(name) > 1:
            raise InputError(path, 1, None, f"{header.count(name)} columns {name}", "one")
    if len(lines) < 2:
        raise InputError(path, None, None, f"{len(lines)} rows of numbers", "at least 2")
    for line, cells in lines:
        if len(cells) != len(header):
            raise InputError(path, line, None, f"{len(cells)} cells", f"{len(header)}, as in the header")
    return {name: _numbers(path, name, header.index(name), lines) for name in names}


def _numbers(path: Path, name: str, place: int, lines: list[tuple[int, list[str]]]) -> Floats:
    values = np.empty(len(lines))
    for row, (line, cells) in enumerate(lines):
        try:
            values[row] = float(cells[place])
        except ValueError:
            values[row] = math.nan
        if not math.isfinite(values[row]):
            raise InputError(path, line, place + 1, f"'{cells[place]}' in column {name}", "a finite number")
    return values


def _read_text(path: Path) -> str:
    try:
        if path.suffix == ".gz":
            with gzip.open(path) as file:
                raw = file.read(_MOST_BYTES + 1)
        else:
            with path.open("rb") as file:
                raw = file.read(_MOST_BYTES + 1)
        if len(raw) > _MOST_BYTES:
            raise InputError(path, None, None, "a very large file", f"at most {_MOST_BYTES // 1_000_000} MB")
        return raw.decode("utf-8-sig")
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(path, None, None, f"a file that cannot be read ({reason})", "a CSV file") from None
    except UnicodeDecodeError:
        raise InputError(path, None, None, "bytes that are not UTF-8 text", "a CSV file") from None


def check_times(path: Path, times: Floats, uniform: bool = False) -> None:
    """Refuse times that do not rise, or that are not evenly spaced where that is wanted."""
    steps = np.diff(times)
    falling = np.flatnonzero(steps <= 0.0)
    if falling.size:
        raise InputError(path, int(falling[0]) + 3, None, f"the time {times[falling[0] + 1]:g} s", "times that rise")
    if uniform:
        step = float(np.median(steps))
        off = np.flatnonzero(np.abs(steps - step) > _EVEN * step)
        if off.size:
            found = f"{steps[off[0]]:g} s since the row before"
            raise InputError(path, int(off[0]) + 3, None, found, f"evenly spaced rows, {step:g} s apart")
