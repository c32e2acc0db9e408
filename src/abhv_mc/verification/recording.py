"""Other people's time histories: CSV files, plain or compressed, read column by column."""

import gzip
import zlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import InputError
from abhv_mc.vehicle.table_file import split_rows

_MOST_BYTES = 200_000_000
_EVEN = 0.02  # of the spacing: printed times are rounded


def read_columns(path: Path, names: Iterable[str]) -> dict[str, Floats]:
    """The named columns ``[row]`` of a ``.csv`` or ``.csv.gz`` file; others are left unread.

    Raises :class:`InputError` for a missing column, a cell that is no finite number, or fewer than two rows.
    """
    rows = split_rows(path, _read_text(path))
    columns: dict[str, Floats] = {}
    for name in names:
        places = [i for i, column in enumerate(rows.header) if column == name]
        if not places:
            raise rows.error(None, None, f"no column {name}", "it: the comparison needs it")
        if any(not np.array_equal(rows.numbers(place), rows.numbers(places[0])) for place in places[1:]):
            raise rows.error(None, None, f"{len(places)} columns {name} that differ", "one")
        columns[name] = rows.numbers(places[0])
    if len(rows.cells) < 2:
        raise InputError(path, f"{len(rows.cells)} rows of numbers", "at least 2")
    return columns


def _read_text(path: Path) -> str:
    try:
        if path.suffix == ".gz":
            with gzip.open(path) as file:
                raw = file.read(_MOST_BYTES + 1)
        else:
            with path.open("rb") as file:
                raw = file.read(_MOST_BYTES + 1)
        if len(raw) > _MOST_BYTES:
            raise InputError(path, "a very large file", f"at most {_MOST_BYTES // 1_000_000} MB")
        return raw.decode("utf-8-sig")
    except (OSError, EOFError, zlib.error) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(path, f"a file that cannot be read ({reason})", "a CSV file") from None
    except UnicodeDecodeError:
        raise InputError(path, "bytes that are not UTF-8 text", "a CSV file") from None


def stack_columns(columns: dict[str, Floats], names: list[str]) -> Floats:
    """Columns side by side, ``[row, name]``."""
    return np.stack([columns[name] for name in names], axis=-1)


def check_times(path: Path, times: Floats, uniform: bool = False) -> None:
    """Refuse times that do not rise, or that are not evenly spaced where that is wanted."""
    steps = np.diff(times)
    falling = np.flatnonzero(steps <= 0.0)
    if falling.size:
        raise InputError(path, f"the time {times[falling[0] + 1]:g} s", "times that rise", int(falling[0]) + 3)
    if uniform:
        step = float(np.median(steps))
        off = np.flatnonzero(np.abs(steps - step) > _EVEN * step)
        if off.size:
            found = f"{steps[off[0]]:g} s since the row before"
            raise InputError(path, found, f"evenly spaced rows, {step:g} s apart", int(off[0]) + 3)
