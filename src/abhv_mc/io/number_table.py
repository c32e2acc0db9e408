"""A CSV file of numbers with a header, and the places of what is wrong in it."""

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError
from abhv_mc.io.input_files import read_input


@dataclass(frozen=True)
class NumberTable:
    """Numbers by row and column, all finite; rows without any cell are left out."""

    path: Path
    names: tuple[str, ...]
    values: NDArray[np.float64]  # [row, column]
    lines: tuple[int, ...]  # of the file, by row

    def error(self, row: int, name: str, found: str, expected: str) -> InputError:
        """What is wrong with the number in that row under that name, at its place in the file."""
        line = self.lines[row]
        reader = csv.reader(_lines_of(self.path))
        header = next(reader)
        cells = next(cells for cells in reader if reader.line_num >= line)
        place = [cell.strip() for cell in header].index(name)
        return InputError(self.path, found, expected, line, _column(cells, place))

    def check_rising(self, name: str, unit: str) -> None:
        """Raise :class:`InputError` at the first number under that name that is not above the one before."""
        values = self.values[:, self.names.index(name)]
        for row in np.flatnonzero(np.diff(values) <= 0.0)[:1] + 1:
            quantity = name.partition("_")[0]
            raise self.error(int(row), name, f"the {quantity} {values[row]:g} {unit}", f"{quantity}s that rise")


def read_number_table(path: Path, expected: Mapping[str, float] | None = None) -> NumberTable:
    """These columns, in order, with the largest magnitude of each; all where None. Raises :class:`InputError`."""
    rows: list[list[float]] = []
    lines: list[int] = []
    try:
        reader = csv.reader(_lines_of(path))
        header = [name.strip() for name in next(reader, [])]
        names = tuple(header if expected is None else expected)
        missing = [name for name in names if name not in header]
        if missing:
            raise InputError(path, f"no column {', '.join(missing)}", f"the columns {', '.join(names)}", 1, 1)
        twice = [name for name in names if header.count(name) > 1]
        if twice:
            raise InputError(path, f"the column {twice[0]} twice", "each column once", 1)
        places = [(header.index(name), math.inf if expected is None else expected[name]) for name in names]
        for cells in reader:
            if not cells:
                continue
            if expected is None and len(cells) != len(header):
                raise InputError(path, f"{len(cells)} cells", f"{len(header)} cells", reader.line_num)
            rows.append([_number(path, reader.line_num, cells, place, most) for place, most in places])
            lines.append(reader.line_num)
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise InputError(path, str(error), "a CSV file of numbers in UTF-8") from None
    return NumberTable(path, names, np.array(rows, dtype=np.float64).reshape(len(rows), len(names)), tuple(lines))


def _lines_of(path: Path) -> StringIO:
    return StringIO(read_input(path).decode("utf-8-sig"), newline="")


def _number(path: Path, line: int, cells: list[str], place: int, most: float) -> float:
    text = cells[place].strip() if place < len(cells) else ""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(path, f"'{text}'", "a finite number", line, _column(cells, place))
    if abs(value) > most:
        raise InputError(path, f"'{text}'", f"a magnitude of at most {most:g}", line, _column(cells, place))
    return value


def _column(cells: list[str], place: int) -> int:
    return sum(len(cell) + 1 for cell in cells[:place]) + 1
