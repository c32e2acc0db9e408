"""Tables from other programs: CSV of any dialect, JSON Lines, Parquet and Excel.

The reader keeps the source location of each cell for error messages. All tables of flights,
samples, missions, vehicles and gains are read with the same rules for units in column headings.
"""

import codecs
import csv
import gzip
import io
import json
import math
import re
import sys
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.io.input_files import read_input
from abhv_mc.io.messages import InputError, Refusal, counted, describe, one_of, quoted
from abhv_mc.io.units import NUMBER, Dimension, parse_in_any_unit, parse_unit

if TYPE_CHECKING:  # Workers read no tables and do not need to import pyarrow.
    import pyarrow as pa

_NUMBER = re.compile(NUMBER.replace("eE", "eEdD"))  # Fortran writes exponents as in 1.0D+03.
DECIMAL, THOUSANDS = "decimal", "thousands"  # meanings of the commas in numbers
_SIGN, _EXPONENT = "^[+\N{MINUS SIGN}-]?", "[eEdD][+-]?[0-9]+"
_GROUPS = f"{_SIGN}[1-9][0-9]{{0,2}}(,[0-9]{{3}})+"
_ONLY_THOUSANDS = rf"{_GROUPS}(,[0-9]{{3}}|\.[0-9]*)$"
_ONLY_DECIMAL = (
    f"{_SIGN}((0[0-9]*|[0-9]{{4,}})?,[0-9]+({_EXPONENT})?"
    f"|[0-9]+,([0-9]{{1,2}}|[0-9]{{4,}}|[0-9]+{_EXPONENT}))$"
)
_WORDS = {
    **dict.fromkeys(("", "nan", "null", "none", "na", "n/a", "#n/a"), math.nan),
    **dict.fromkeys(("inf", "+inf", "infinity"), math.inf),
    **dict.fromkeys(("-inf", "-infinity"), -math.inf),
}
_TRUTH = {"true": 1.0, "false": 0.0}
_COMMENT = re.compile(r"\s*(?:#(?!N/A)|%|!|//|---)")
_UNIT_IN_BRACKETS = re.compile(r"(.*?)\s*(?:\[([^][]*)\]|\(([^()]*)\)|\{([^{}]*)\})")
_UNIT_AFTER_SIGN = re.compile(r"(.*?\S)(?:\s*/\s+|\s+/\s*|,\s+|\s+in\s+)(\S+)")
_SUFFIXES = {
    "mps": "m/s",
    "fps": "ft/s",
    "dps": "deg/s",
    "kgps": "kg/s",
    "kg m3": "kg/m3",
    "w m2": "W/m2",
    **{unit.lower(): unit for unit in ("K", "N", "kN", "Pa", "hPa", "kPa", "Hz", "W", "kW")},
    **{f"{length} {time}": f"{length}/{time}" for length in ("m", "km", "ft") for time in "sh"},
    "min": "?",
}  # in column names such as altitude_min, 'min' means minimum, not minutes
_CORNER = "\\"  # separator of the names of a matrix's two axes
_BLANKS = " "  # separator that represents any number of blanks or tabs
_FEW = 1000  # maximum number of rows that are parsed in Python
_BLOCK = 2**22  # approximate size of a block of lines that Arrow parses, bytes
# quotes, comments, blank lines and line ends that Arrow would read differently
_IRREGULAR = re.compile(rb' "|\n[#%!/ \t\n\r]|\n---|\r[^\n]|\x0b|\x0c|\x1c|\x1d|\x1e')
_LONGEST_LIST = 20  # maximum length of a JSON list whose items become columns


class Column(NamedTuple):
    """Column of a table: index (from 0), and unit from the heading or the row of units."""

    position: int
    unit: str = ""


@dataclass(frozen=True)
class ForeignTable:
    """Table whose columns contain text, or values as stored in a Parquet file."""

    path: Path
    heads: tuple[str, ...]
    # units in the row below the headings; empty strings if there is no such row
    units: tuple[str, ...]
    data: "pa.Table"  # columns in the order of the headings
    # [row] number (from 1) of the line in the file, or of the row in Parquet
    lines: "Sequence[int] | Ints"
    head_line: int = 1
    head_text: str = ""  # original line of the headings
    separator: str = ""  # empty if the file does not consist of lines of cells
    comma: str = ""  # declared meaning of commas in numbers: DECIMAL, THOUSANDS or none
    is_cut: bool = False  # whether the last line has no end
    # [row] index of the cell that contains the value, if the file is a matrix
    value_cells: Sequence[int] = ()

    def __len__(self) -> int:
        return int(self.data.num_rows)

    def error(self, row: int | None, column: int | None, problem: str, expected: str) -> InputError:
        """Return the InputError for a cell.

        If ``row`` is None, the cell is a heading. If ``column`` is None, the error states only the
        line.
        """
        if self.value_cells and column != len(self.heads) - 1:
            column = None
        located, start = self.position(row, column or 0)
        has_column = column is not None and self.separator
        return InputError(self.path, problem, expected, located, start if has_column else None)

    def check_heads(self, columns: Mapping[str, Column], names: Iterable[str]) -> None:
        """Raise InputError for a heading that is not one of the found ``columns``."""
        positions = {column.position for column in columns.values()}
        for i, head in enumerate(self.heads):
            if i not in positions:
                raise self.error(None, i, f"unknown column '{head}'", one_of(names, head))

    def position(self, row: int | None, column: int) -> tuple[int, int]:
        """Return the line and column (from 1) of a cell, or of a heading if ``row`` is None."""
        line = self.head_line if row is None else int(self.lines[row])
        if row is not None and self.value_cells:
            column = self.value_cells[row]
        if not self.separator:
            return line, 1 + column
        text = self.head_text if row is None else "".join(self._texts[line - 1 : line])
        starts = _cell_starts(text, self.separator)
        return line, 1 + starts[min(column, len(starts) - 1)]

    @cached_property
    def _texts(self) -> list[str]:
        """Lines of the file, which are read again because they take more memory than the cells."""
        return _read_content(self.path).decode().splitlines()

    def find(
        self, names: Collection[str], heads: Mapping[str, str] | None = None
    ) -> dict[str, Column]:
        """Return the columns of ``names`` that exist in the table.

        A heading is a name, optionally with a unit: 'altitude [ft]', 'altitude (ft)', 'altitude
        {ft}' or 'altitude_ft'. ``heads`` maps names to the headings that replace them. Raise
        InputError if two columns match one name.
        """
        columns = {}
        known_names = frozenset(names)
        for index, head in enumerate(self.heads):
            name, unit = read_head(head, known_names)
            if name and name not in (heads or {}):
                if name in columns:
                    expected = "only one column for each name, regardless of the unit"
                    raise self.error(None, index, f"the table has two columns '{name}'", expected)
                columns[name] = Column(index, unit or self.units[index])
        for name, head in (heads or {}).items():
            if name in names and (column := self._find_head(head)):
                columns[name] = column
        return columns

    def _find_head(self, head: str) -> Column | None:
        for text, unit in ((head, ""), split_head(head)):
            indices = [i for i, own in enumerate(self.heads) if text in (own, split_head(own)[0])]
            indices = [i for i in indices if self.heads[i] == text] or indices
            for index in indices[1:]:
                expected = "only one column with this heading"
                raise self.error(None, index, f"the table has two columns '{text}'", expected)
            for index in indices:
                own = self.heads[index]
                # In a heading with any name, such as 'v_n', a small letter is not a unit.
                suffixes = [u for _, u in _split_suffix(own) if len(u) > 1 or own.endswith(u)]
                stated = split_head(own)[1] or self.units[index] or next(iter(suffixes), "")
                return Column(index, unit or stated)
        return None

    def factor(self, column: Column, unit: str) -> float:
        """Return the conversion factor from a column's unit to ``unit``.

        Raise InputError if the units are incompatible.
        """
        if column.unit in ("", unit):
            return 1.0
        try:
            return parse_in_any_unit(f"1 {column.unit}", unit)
        except Refusal as refusal:
            problem = f"invalid unit in '{self.heads[column.position]}' ({refusal.found})"
            raise self.error(None, column.position, problem, refusal.expected) from None

    def numbers(
        self,
        columns: Sequence[int],
        finite: bool = True,
        dimensional: Collection[int] = (),
        fits: Callable[[Floats], Mask] | None = None,
    ) -> Floats:
        """Return columns as numbers [row, column], with NaN for empty cells.

        In the columns ``dimensional``, true and false are not numbers. ``fits`` returns a mask of
        the plausible columns, which decides if commas have two readings. Raise InputError for
        text, for commas with two readings and, if ``finite``, for numbers that are not finite.
        """
        cells = [self.data.column(i) for i in columns]
        if any(map(_has_comma, cells)):
            cells = list(map(_plain, cells))
            meaning = self.comma or self._find_meaning(columns, cells)
            if not meaning and fits:
                readings = (_without_commas(cells, reading) for reading in (DECIMAL, THOUSANDS))
                masks = [fits(self._parse(columns, own, dimensional)) for own in readings]
                signs = {*np.subtract(*masks, dtype=int)} - {0}
                meaning = {(1,): DECIMAL, (-1,): THOUSANDS}.get(tuple(signs), "")
            cells = _without_commas(cells, meaning) if meaning else cells
        out = self._parse(columns, cells, dimensional)
        for row, i in np.argwhere(~np.isfinite(out))[:1] if finite else ():
            raise self._no_number(int(row), columns[i])
        return out

    def _find_meaning(self, columns: Sequence[int], plain: "Sequence[pa.ChunkedArray]") -> str:
        """Return the meaning of commas that numbers of the file imply, or '' if none does.

        Numbers in ``columns``, with the cells ``plain``, precede those in the other columns.
        """
        import pyarrow as pa
        import pyarrow.compute as pc

        cells = dict(enumerate(self.data.columns)) | dict(zip(columns, plain, strict=True))
        texts = [i for i, column in cells.items() if pa.types.is_string(column.type)]

        def count(pattern: str, indices: Sequence[int]) -> int:
            return sum(
                pc.sum(pc.match_substring_regex(cells[i], pattern)).as_py() or 0 for i in indices
            )

        own = [i for i in columns if i in texts]
        # A number with a point in a column that is read excludes decimal commas.
        with_point = re.sub(r",(?=[\[(])", r"\\.", _ONLY_DECIMAL)
        decimal, thousands = (
            count(pattern, own) for pattern in (_ONLY_DECIMAL, f"{_ONLY_THOUSANDS}|{with_point}")
        )
        if not decimal and not thousands:
            grouped = [i for i in texts if count(f"{_GROUPS}$", [i])]
            decimal = count(_ONLY_DECIMAL, texts) + count(f"{_SIGN}[0-9]{{4,}}$", grouped)
            thousands = count(_ONLY_THOUSANDS, texts)
            if decimal and thousands:
                return ""
        return DECIMAL if decimal > thousands else THOUSANDS if thousands else ""

    def _parse(
        self,
        columns: Sequence[int],
        cells: "Sequence[pa.ChunkedArray]",
        dimensional: Collection[int],
    ) -> Floats:
        """Parse cells [column][row] as numbers. Raise InputError at the first invalid cell."""
        import pyarrow as pa

        from abhv_mc.io.parquet_columns import column_values

        numbers = np.empty((len(self), len(columns)))
        plain = map(_plain, cells) if len(self) > _FEW else cells  # The import takes 0.1 s.
        for i, (column, own) in enumerate(zip(columns, plain, strict=True)):
            constants = _WORDS if column in dimensional else _WORDS | _TRUTH
            if len(self) > _FEW and not (constants is _WORDS and pa.types.is_boolean(own.type)):
                with suppress(pa.ArrowException, ValueError):
                    numbers[:, i] = column_values(own.cast(pa.float64(), safe=False))
                    continue
            for row, cell in enumerate(own.to_pylist()):
                text = "" if cell is None else str(cell).strip().replace("\N{MINUS SIGN}", "-")
                text = text.lower()
                is_number = _NUMBER.fullmatch(text)
                number = float(text.replace("d", "e")) if is_number else constants.get(text)
                if number is None:
                    raise self._no_number(row, column)
                numbers[row, i] = number
        return numbers

    def _no_number(self, row: int, column: int) -> InputError:
        text, expected = self.words(column)[row], "a finite number"
        problem = f"found {describe(text)} in the column '{self.heads[column]}'"
        if re.fullmatch(_GROUPS, text):
            problem = f"'{text}' is {text.replace(',', '.')} or {text.replace(',', '')}"
            expected = (
                f"'{DECIMAL}: \",\"' or '{THOUSANDS}: \",\"' beside 'columns' where the table is "
                "declared, or numbers without commas"
            )
        return self.error(row, column, problem, expected)

    def words(self, column: int) -> list[str]:
        """Return a column as strings [row], with empty strings for empty cells."""
        return [
            "" if cell is None else sys.intern(str(cell))
            for chunk in _plain(self.data.column(column)).chunks
            for cell in chunk.to_pylist()
        ]


def _plain(column: "pa.ChunkedArray") -> "pa.ChunkedArray":
    """Return a column without dictionary encoding, and text stripped."""
    import pyarrow as pa

    if pa.types.is_dictionary(column.type):
        column = column.cast(column.type.value_type)
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        import pyarrow.compute as pc  # imported here because the import takes 0.1 s

        return pc.utf8_trim_whitespace(column.cast(pa.string()))
    return column


def _has_comma(column: "pa.ChunkedArray") -> bool:
    chunks = column.chunks if "string" in str(column.type) else ()
    texts = [getattr(chunk, "dictionary", chunk).buffers()[2] for chunk in chunks]
    return any(b"," in text.to_pybytes() for text in texts if text)


def _without_commas(columns: "Sequence[pa.ChunkedArray]", meaning: str) -> "list[pa.ChunkedArray]":
    """Return columns with decimal points; cells that contradict ``meaning`` are no numbers."""
    import pyarrow as pa
    import pyarrow.compute as pc

    def read(column: "pa.ChunkedArray") -> "pa.ChunkedArray":
        if not pa.types.is_string(column.type):
            return column
        if meaning == DECIMAL:
            return pc.replace_substring(pc.replace_substring(column, ".", "?"), ",", ".")
        is_grouped = pc.match_substring_regex(column, rf"{_GROUPS}(\.[0-9]*)?$")
        return pc.if_else(is_grouped, pc.replace_substring(column, ",", ""), column)

    return list(map(read, columns))


def split_head(head: str) -> tuple[str, str]:
    """Split a heading such as 'altitude [ft]' or 'altitude / ft' into a name and a unit.

    The unit may be empty. An index as in 'x[0]' is not a unit.
    """
    match = _UNIT_IN_BRACKETS.fullmatch(head)
    unit = next(filter(None, match.groups()[1:]), "").strip() if match else ""
    if match and match[1] and not unit.isdecimal():
        return match[1], unit
    if (match := _UNIT_AFTER_SIGN.fullmatch(head)) and _is_unit(match[2]):
        return match[1], match[2]
    return head, ""


def _split_suffix(head: str) -> list[tuple[str, str]]:
    """Split a heading such as 'altitude_ft' into a name and a unit in each possible way.

    The result begins with the shortest name.
    """
    segments = head.split("_")
    splits = [("_".join(segments[:i]), " ".join(segments[i:])) for i in range(1, len(segments))]
    named = [(name, _SUFFIXES.get(suffix, suffix)) for name, suffix in splits]
    return [(name, unit) for name, unit in named if _is_unit(unit)]


def _is_unit(text: str) -> bool:
    """Return whether the text is a unit; a number such as '1' is not a unit."""
    try:
        parse_unit(text)
    except Refusal:
        return False
    return not text.isdecimal()


def read_head(head: str, names: Collection[str]) -> tuple[str, str]:
    """Return the name and the unit in a heading; both are empty if the name is unknown.

    ``names`` are the known names.
    """
    if head in names:
        return head, ""
    stem, unit = split_head(head)
    if stem in names:
        return stem, unit
    splits = [] if unit else [split for split in _split_suffix(stem) if split[0] in names]
    return splits[-1] if splits else ("", "")


def read_foreign_table(path: Path, has_units: bool = True, comma: str = "") -> ForeignTable:
    """Read a table from a CSV (plain or gzipped), JSON Lines, Parquet or Excel file.

    CSV files may have any separator. If ``has_units``, a row of units may follow the headings.
    ``comma`` is the meaning of commas in numbers. Raise InputError if the file cannot be read.
    """
    try:
        content = _read_content(path)
        if path.suffix.lower() in (".parquet", ".pq"):
            import pyarrow as pa
            import pyarrow.parquet as pq

            from abhv_mc.io.parquet_columns import arrow_memory

            data = pq.read_table(pa.BufferReader(arrow_memory(content)))
            heads = tuple(map(str, data.column_names))
            return ForeignTable(
                path, heads, ("",) * len(heads), data, range(1, 1 + len(data)), comma=comma
            )
        if path.suffix.lower() in (".xlsx", ".xlsm"):
            table = _read_text(path, _sheet_text(content), has_units)
            # Errors in a spreadsheet state only the row.
            return replace(table, separator="", comma=comma)
        read = _read_json if content.lstrip()[:1] == b"{" else _read_lines
        table = read(path, content, has_units)
        return replace(
            table,
            comma=comma,
            is_cut=content[-1:] not in (b"\r", b"\n"),
            separator=table.separator if path.is_file() else "",  # A pipe is read only once.
        )
    except (OSError, EOFError, zlib.error, ValueError, ImportError, csv.Error) as error:
        reason = getattr(error, "strerror", None) or str(error).splitlines()[0]
        raise InputError(
            path,
            f"the file cannot be read ({reason.rstrip('.')})",
            "CSV in UTF-8 (in Excel: CSV UTF-8), JSON Lines, Parquet or Excel",
        ) from None


def _read_content(path: Path) -> bytes:
    """Return the bytes of a file, decompressed; text is in UTF-8 without a byte order mark."""
    content = read_input(path)
    if path.suffix == ".gz":
        content = gzip.decompress(content)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        content = content.decode("utf-16").encode()
    return content.removeprefix(codecs.BOM_UTF8)


def _sheet_text(content: bytes) -> str:
    """Return the first sheet of an Excel file as tab-separated text.

    Raise ImportError if openpyxl is not installed.
    """
    import pandas as pd

    sheet = pd.read_excel(io.BytesIO(content), header=None, dtype=object)
    return sheet.to_csv(sep="\t", header=False, index=False)


def _read_json(path: Path, content: bytes, _: bool) -> ForeignTable:
    """Read a file with one JSON object per line; nested values become columns 'position[0]'."""
    rows: list[dict[str, str]] = []
    lines = [
        (number, line)
        for number, line in enumerate(content.decode().splitlines(), 1)
        if line.strip()
    ]
    for number, line in lines:
        try:
            rows.append(dict(_leaves("", json.loads(line))))
        except ValueError as error:
            raise InputError(
                path, f"invalid JSON ({error})", "a JSON object on each line", number
            ) from None
    heads = tuple(dict.fromkeys(head for row in rows for head in row))
    data = _text_table(heads, ([row.get(head, "") for row in rows] for head in heads))
    return ForeignTable(path, heads, ("",) * len(heads), data, [number for number, _ in lines])


def _text_table(heads: Iterable[str], columns: Iterable[Sequence[str]]) -> "pa.Table":
    import pyarrow as pa

    return pa.table([pa.array(column, pa.string()) for column in columns], names=list(heads))


def _leaves(name: str, value: Any) -> Iterator[tuple[str, str]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(f"{name}.{key}" if name else key, inner)
    elif isinstance(value, list):
        for i, inner in enumerate(value if len(value) <= _LONGEST_LIST else ()):
            yield from _leaves(f"{name}[{i}]", inner)
    else:
        yield name, "" if value is None else str(value)


def _read_lines(path: Path, content: bytes, may_have_units: bool) -> ForeignTable:
    """Read lines of cells; in a large file, plain rows are read in blocks to save memory."""
    import pyarrow as pa

    if top := re.match(rb"(?:.*\n){%d}" % _FEW, content):
        with suppress(InputError, pa.ArrowInvalid):  # All lines are needed for the first error.
            text, start = top[0].decode(), top.end()
            table = _read_text(path, text, may_have_units)
            blocks, is_plain = [table.data], table.separator != _BLANKS
            while is_plain and start < len(content):
                stop = content.find(b"\n", start + _BLOCK) + 1 or len(content)
                block, start = content[start - 1 : stop], stop
                cells = _parse_cells(block[1:], len(table.heads), table.separator)
                is_plain = block.isascii() and not _IRREGULAR.search(block)
                is_plain &= len(cells) == block[1:-1].count(b"\n") + 1
                blocks.append(cells)
            if is_plain:
                data = pa.concat_tables(blocks)
                added = 1 + len(text.splitlines()) + np.arange(len(data) - len(table))
                return replace(table, data=data, lines=np.append(table.lines, added))
    return _read_text(path, content.decode(), may_have_units)


def _parse_cells(body: bytes, count: int, separator: str) -> "pa.Table":
    """Parse lines of ``count`` cells as strings."""
    import pyarrow as pa
    import pyarrow.csv as arrow_csv

    from abhv_mc.io.parquet_columns import arrow_memory

    names = list(map(str, range(count)))
    return arrow_csv.read_csv(
        pa.BufferReader(arrow_memory(body)),
        arrow_csv.ReadOptions(column_names=names),
        arrow_csv.ParseOptions(delimiter=separator, ignore_empty_lines=False),
        arrow_csv.ConvertOptions(column_types=dict.fromkeys(names, pa.string())),
    )


def _read_text(path: Path, text: str, may_have_units: bool) -> ForeignTable:
    """Read a line of headings, then lines of cells; blank lines and comments are skipped."""
    lines: dict[int, str] = {}
    comments = []
    start = 0  # first line of a quoted cell that spans several lines
    for number, line in enumerate(text.splitlines(), 1):
        if start:
            lines[start] += f"\n{line}"
        elif _COMMENT.match(line):
            comments.append((number, _COMMENT.sub("", line)))
            continue
        elif line.strip():
            lines[number] = line
        open_quote = '"' in line and lines.get(start or number, "").count('"') % 2
        start = (start or number) if open_quote else 0
    first = next(iter(lines.values()), "")
    separator = _find_separator(list(lines.values())[:2])
    cells = split_line(first, separator)
    for line in list(lines.values())[:2]:
        if _CORNER in line:
            return _read_matrix(path, lines, _find_separator([line]))
    if any(map(_NUMBER.fullmatch, cells)):  # Dakota and numpy write the headings as a comment.
        for number, line in reversed(comments):
            if number < next(iter(lines)) and len(split_line(line, separator)) == len(cells):
                lines = {number: line, **lines}
                break
    if len(lines) < 2:
        raise InputError(path, "the table has no rows", "a line of headings and rows of numbers", 1)
    (head, *texts), (head_line, *numbers) = lines.values(), lines
    heads = tuple(split_line(head, separator))
    units = [unit.strip("[](){} ") for unit in split_line(texts[0], separator)]
    if may_have_units and len(texts) > 1 and len(units) == len(heads) and _are_units(units):
        del texts[0], numbers[0]
    else:
        units = [""] * len(heads)
    for number, line in zip(numbers, texts, strict=True):
        if (count := len(split_line(line, separator))) != len(heads):
            raise InputError(
                path,
                f"found {counted(count, 'cell')}",
                f"{counted(len(heads), 'cell')}, as in the heading",
                number,
            )
    body = "\n".join(texts)
    if '"' in body or separator == _BLANKS:
        rows = (split_line(line, separator) for line in texts)
        data = _text_table(map(str, range(len(heads))), zip(*rows, strict=True))
    else:
        data = _parse_cells(body.encode(), len(heads), separator)
    return ForeignTable(
        path=path,
        heads=heads,
        units=tuple(units),
        data=data,
        lines=numbers,
        head_line=head_line,
        head_text=head,
        separator=separator,
    )


def _read_matrix(path: Path, lines: Mapping[int, str], separator: str) -> ForeignTable:
    """Read one or more matrices as a table with one row per matrix cell.

    The corner cell names the axes of rows and columns, as in 'mach\\alpha_deg'. With a third axis,
    each block begins with a line such as 'altitude_m = 1000'.
    """
    outer: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    heads: list[str] = []
    rows: list[tuple[str, ...]] = []
    numbers: list[int] = []
    value_cells: list[int] = []
    for number, line in lines.items():
        cells = split_line(line.replace("=", separator), separator)
        while cells and not cells[-1]:
            cells.pop()
        if _CORNER in cells[0]:
            corner = tuple(name.strip() for name in cells[0].split(_CORNER))
            names, heads = (*outer[:1], *corner, "value"), cells[1:]
        elif not _NUMBER.fullmatch(cells[0].replace(",", ".")):
            outer = tuple(cells)
        elif len(cells) != len(heads) + 1:
            raise InputError(
                path,
                f"found {counted(len(cells), 'cell')}",
                f"{len(heads) + 1} cells, as in the heading",
                number,
            )
        else:
            rows += [(*outer[1:], cells[0], *own) for own in zip(heads, cells[1:], strict=True)]
            numbers += [number] * len(heads)
            value_cells += range(1, 1 + len(heads))
        if len(outer) not in (0, 2) or len(names) not in (0, 3 + len(outer) // 2):
            expected = (
                "'name\\name' followed by column headings (after a line 'name = number' if there "
                "is a third axis)"
            )
            raise InputError(path, f"found '{line.strip()}'", expected, number)
    if not rows:
        raise InputError(path, "the matrix has no rows", "a row heading and numbers in each row", 1)
    return ForeignTable(
        path=path,
        heads=names,
        units=("",) * len(names),
        data=_text_table(names, zip(*rows, strict=True)),
        lines=numbers,
        separator=separator,
        value_cells=value_cells,
    )


def _are_units(cells: Sequence[str]) -> bool:
    """Return whether a row contains units: no number and at least one known unit."""
    if any(
        _NUMBER.fullmatch(cell.replace(",", ".")) or cell.lower() in _WORDS | _TRUTH
        for cell in cells
        if cell
    ):
        return False
    return any(cell not in ("", "-") and _is_unit(cell) for cell in cells)


def _find_separator(lines: Sequence[str]) -> str:
    """Return the first separator that splits the first two lines into equally many cells."""
    counts = {
        separator: [len(split_line(line, separator)) for line in lines]
        for separator in (";", "\t", ",", _BLANKS)
    }
    splitting = [separator for separator, count in counts.items() if count[:1] > [1]]
    fitting = [separator for separator in splitting if len({*counts[separator]}) == 1]
    return next(iter(fitting + splitting), ",")


def split_line(line: str, separator: str) -> list[str]:
    """Split a line into cells without surrounding blanks."""
    if '"' not in line:
        return line.split() if separator == _BLANKS else [c.strip() for c in line.split(separator)]
    plain = line.strip() if separator == _BLANKS else line
    return [
        c.strip() for c in next(csv.reader([plain], delimiter=separator, skipinitialspace=True))
    ]


def _cell_starts(line: str, separator: str) -> list[int]:
    """Return the position of the first character of each cell in a line."""
    gap = r"[ \t]+" if separator == _BLANKS else f" *{separator} *"
    text = line.lstrip(" \t" if separator == _BLANKS else " ")
    indent = len(line) - len(text)
    gaps = (match for match in re.finditer(f'"[^"]*"|({gap})', text) if match[1])
    return [indent, *(indent + match.end() for match in gaps)]


@dataclass(frozen=True)
class NumberTable:
    """Columns of a file as finite numbers."""

    table: ForeignTable
    columns: Mapping[str, Column]
    values: Floats  # [row, column]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.columns)

    def error(self, row: int, name: str, problem: str, expected: str) -> InputError:
        """Return the InputError for the number in one row of the column ``name``."""
        return self.table.error(row, self.columns[name].position, problem, expected)

    def check_rising(self, name: str, unit: str, or_falling: bool = False) -> None:
        """Raise InputError at the first number of a column that does not exceed its predecessor."""
        values = self.values[:, self.names.index(name)]
        falls = or_falling and values[0] > values[-1]
        for row in np.flatnonzero(np.diff(-values if falls else values) <= 0.0)[:1] + 1:
            expected = f"{name}s that {'decrease' if falls else 'increase'}"
            raise self.error(
                int(row), name, f"the {name} {values[row]:g} {unit} is out of order", expected
            )


def read_numbers(path: Path, dimensions: Mapping[str, Dimension]) -> NumberTable:
    """Read columns as finite numbers in SI units and radians. Raise InputError if invalid."""
    table = read_foreign_table(path)
    return take_numbers(table, table.find(dimensions), dimensions)


def take_numbers(
    table: ForeignTable, columns: Mapping[str, Column], dimensions: Mapping[str, Dimension]
) -> NumberTable:
    """Convert columns to finite numbers in SI units and radians. Raise InputError if invalid."""
    factors = []
    for name, dimension in dimensions.items():
        if name not in columns:
            expected = f"one column for each of {quoted(dimensions)}"
            raise table.error(None, None, f"the table has no column '{name}'", expected)
        column = columns[name]
        if dimension.unit != "-" and not column.unit:
            problem = f"'{table.heads[column.position]}' has no unit"
            expected = f"{dimension.name}, such as '{name} [{dimension.unit}]'"
            raise table.error(None, column.position, problem, expected)
        factors.append(table.factor(column, dimension.unit))
    values = table.numbers([columns[name].position for name in dimensions]) * factors
    numbers = NumberTable(table, {name: columns[name] for name in dimensions}, values)
    for i, (name, dimension) in enumerate(dimensions.items()):
        for row in np.flatnonzero(np.abs(values[:, i]) > dimension.largest)[:1]:
            problem = f"'{name}' is {values[row, i]:g} {dimension.unit}"
            raise numbers.error(int(row), name, problem, f"at most {dimension.largest:g}")
    return numbers
