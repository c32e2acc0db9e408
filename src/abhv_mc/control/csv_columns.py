"""Columns of numbers from a CSV file with a header, each number within what its quantity may be."""

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from abhv_mc.io.input_error import InputError

_MAX_BYTES = 20_000_000


def read_columns(path: Path, largest: Mapping[str, float]) -> Iterator[tuple[int, list[int], list[float]]]:
    """Line, columns in it (both from 1) and values of each row, of the columns that ``largest`` names, in its order.

    Other columns are left unread. Raises :class:`InputError` for a missing column and for anything but finite numbers
    of at most the magnitude that ``largest`` holds.
    """
    if path.stat().st_size > _MAX_BYTES:
        raise InputError(path, None, None, "a very large file", f"at most {_MAX_BYTES // 1_000_000} MB")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = list(csv.reader(file))
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(path, None, None, str(error), "a CSV file in UTF-8") from None
    header = [name.strip() for name in lines[0]] if lines else []
    missing = [name for name in largest if name not in header]
    if missing:
        raise InputError(path, 1, 1, f"no column {', '.join(missing)}", f"the columns {', '.join(largest)}")
    places = [header.index(name) for name in largest]
    columns = [place + 1 for place in places]
    for number, line in enumerate(lines[1:], start=2):
        if line:
            cells = zip(places, largest.values(), strict=True)
            yield number, columns, [_number(path, number, line, place, bound) for place, bound in cells]


def _number(path: Path, number: int, line: list[str], place: int, largest: float) -> float:
    text = line[place].strip() if place < len(line) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path, number, place + 1, f"'{text}'", "a finite number")
    if abs(value) > largest:
        raise InputError(path, number, place + 1, f"'{text}'", f"a magnitude of at most {largest:g}")
    return value
