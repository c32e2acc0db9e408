"""CSV files of numbers with a header, and the places of what is wrong in them."""

import csv
import gzip
import math
import re
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from abhv_mc.io.input_error import InputError, describe
from abhv_mc.io.input_files import read_input
from abhv_mc.io.units import NUMBER

_DECIMAL = re.compile(NUMBER)


@dataclass(frozen=True)
class Rows:
    """The lines of a CSV file that are neither blank nor comments, which start with ``#``."""

    path: Path
    header: list[str]
    header_line: int
    texts: list[str]  # [row]
    lines: list[int]  # [row] from 1

    def error(self, row: int | None, column: int | None, found: str, expected: str) -> InputError:
        """What to raise about a cell; ``row`` None is the header, ``column`` None the whole line."""
        line = self.header_line if row is None else self.lines[row]
        cells = self.header if row is None else _split(self.path, line, self.texts[row])
        place = None if column is None else 1 + sum(len(cell) + 1 for cell in cells[:column])
        return InputError(self.path, found, expected, line, place)

    def cells(self, row: int) -> list[str]:
        """The cells of a row, as many as the header has. Raises :class:`InputError`."""
        cells = _split(self.path, self.lines[row], self.texts[row])
        if len(cells) != len(self.header):
            raise self.error(
                row, None, f"{len(cells)} cells", f"{len(self.header)}, as in the header"
            )
        return cells

    def numbers(self, columns: Sequence[int]) -> NDArray[np.float64]:
        """Some columns as finite numbers ``[row, column]``. Raises :class:`InputError`."""
        out = np.empty((len(self.texts), len(columns)))
        for row in range(len(self.texts)):
            cells = self.cells(row)
            for i, column in enumerate(columns):
                cell = cells[column].strip()
                out[row, i] = float(cell) if _DECIMAL.fullmatch(cell) else math.nan
                if not math.isfinite(out[row, i]):
                    raise self.error(row, column, describe(cell), "a finite number")
        return out


def read_rows(path: Path) -> Rows:
    """Read a CSV file, plain or ``.gz``. Raises :class:`InputError`."""
    try:
        held = read_input(path)
        text = (gzip.decompress(held) if path.suffix == ".gz" else held).decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        raise InputError(
            path, getattr(error, "strerror", None) or str(error), "a CSV file in UTF-8"
        ) from None
    lines = {
        i: line for i, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"
    }
    if len(lines) < 2:
        raise InputError(path, "no rows", "a header and rows of numbers", 1)
    (header, *texts), (header_line, *numbers) = lines.values(), lines
    return Rows(
        path,
        [name.strip() for name in _split(path, header_line, header)],
        header_line,
        texts,
        numbers,
    )


def _split(path: Path, number: int, line: str) -> list[str]:
    try:
        return next(csv.reader([line])) if '"' in line else line.split(",")
    except csv.Error as error:
        raise InputError(path, str(error), "a CSV file", number) from None


@dataclass(frozen=True)
class NumberTable:
    """Columns of a file as numbers, all finite."""

    rows: Rows
    names: tuple[str, ...]
    values: NDArray[np.float64]  # [row, column]

    def error(self, row: int, name: str, found: str, expected: str) -> InputError:
        """What is wrong with the number in that row under that name, at its place in the file."""
        return self.rows.error(row, self.rows.header.index(name), found, expected)

    def check_rising(self, name: str, unit: str) -> None:
        """Raise :class:`InputError` at the first number under that name that is not above the one before."""
        values = self.values[:, self.names.index(name)]
        for row in np.flatnonzero(np.diff(values) <= 0.0)[:1] + 1:
            quantity = name.partition("_")[0]
            raise self.error(
                int(row), name, f"the {quantity} {values[row]:g} {unit}", f"{quantity}s that rise"
            )


def read_number_table(path: Path, expected: Mapping[str, float] | None = None) -> NumberTable:
    """These columns, in order, with the largest magnitude of each; all where None. Raises :class:`InputError`."""
    rows = read_rows(path)
    names = tuple(rows.header if expected is None else expected)
    for name in names:
        if (count := rows.header.count(name)) != 1:
            found = f"the column {name} twice" if count else f"no column {name}"
            raise rows.error(None, None, found, f"the columns {', '.join(names)}, each once")
    table = NumberTable(rows, names, rows.numbers([rows.header.index(name) for name in names]))
    for i, (name, most) in enumerate((expected or {}).items()):
        for row in np.flatnonzero(np.abs(table.values[:, i]) > most)[:1]:
            raise table.error(
                int(row), name, f"{table.values[row, i]:g}", f"a magnitude of at most {most:g}"
            )
    return table
