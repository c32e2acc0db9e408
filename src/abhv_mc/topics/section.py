"""Report sections as data, to be shown on a page, in a terminal or in a notebook.

Text between backticks is literal, such as a command, a file name or a key.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from textwrap import wrap
from typing import TypeAlias

from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.formatting import bounds, estimate

_WIDTH = 80  # maximum line width of printed records, in columns
_IDLE = {"", "0", "\N{EM DASH}"}


@dataclass(frozen=True)
class Cell:
    """Cell of a table."""

    text: str
    note: str = ""  # small text next to the value, such as an interval
    rows: int = 1  # number of rows that the cell spans; the rows below the first omit the cell
    columns: int = 1
    head: bool = False  # whether the cell is a row header
    verdict: bool = False  # whether the cell is a verdict: PASS, FAIL, NOT SHOWN or ESTIMATE
    flight: tuple[str, int] | None = (
        None  # controller and number of the flight that a click on the cell shows
    )
    hint: str = ""  # tooltip
    best: bool = False  # whether the cell is bold on a page, and marked by * in text


def interval_cell(interval: Interval) -> Cell:
    """Return an estimate with its interval, or 'not reached' if it is infinite."""
    return (
        Cell(estimate(interval), bounds(interval))
        if isfinite(interval.value)
        else Cell("not reached")
    )


Row: TypeAlias = tuple[Cell, ...]


def grouped(rows: Sequence[Row], *heads: Cell) -> tuple[Row, ...]:
    """Return the rows, preceded by header cells that span all rows."""
    return ((*(replace(head, rows=len(rows)) for head in heads), *rows[0]), *rows[1:])


@dataclass(frozen=True)
class Table:
    """Table whose rows form groups; a cell may span several rows of a group."""

    title: str
    heads: tuple[str, ...]
    groups: tuple[tuple[Row, ...], ...]
    caption: str = ""  # text above the table in addition to the title
    numbers: bool = True  # whether most cells are numbers

    def plain_rows(self) -> list[list[str]]:
        """Return all cells as text, each repeated in the rows and columns that it spans."""
        rows: list[list[str]] = []
        for group in self.groups:
            lines = [[""] * len(self.heads) for _ in group]
            for r, located_cells in enumerate(_places(group)):
                for column, cell in located_cells:
                    text = cell.text + "*" * cell.best
                    text += f" ({cell.note})" if cell.note else ""
                    for line in lines[r : r + cell.rows]:
                        line[column : column + cell.columns] = [text] * cell.columns
            rows += lines
        return rows

    def without_constant(self) -> "Table":
        """Return the table with its constant columns moved to the caption.

        Row headers are kept, and a table with a single row is unchanged.
        """
        (rows,) = self.groups
        texts = {column: {row[column].text for row in rows} for column in range(len(self.heads))}
        constant = {
            column: column_texts.pop()
            for column, column_texts in texts.items()
            if len(rows) > 1 and len(column_texts) == 1 and not rows[0][column].head
        }
        constants = [
            f"{self.heads[column]}: {text}"
            for column, text in constant.items()
            if text not in _IDLE
        ]
        caption = f"{self.caption or self.title}. In all rows: {'; '.join(constants)}"
        return replace(
            self,
            heads=tuple(head for column, head in enumerate(self.heads) if column not in constant),
            groups=(
                tuple(
                    tuple(cell for column, cell in enumerate(row) if column not in constant)
                    for row in rows
                ),
            ),
            caption=caption if constants else self.caption,
        )

    def without_idle(self) -> "Table":
        """Return the table without columns whose cells are all empty or zero."""
        placed = [_places(group) for group in self.groups]
        used_columns = {
            column
            for located_rows in placed
            for row in located_rows
            for column, cell in row
            if cell.head or cell.note or (cell.columns == 1 and cell.text not in _IDLE)
        }
        if len(used_columns) == len(self.heads) or not self.groups:
            return self
        groups = tuple(
            tuple(
                tuple(
                    replace(cell, columns=width)
                    for column, cell in row
                    if (
                        width := len(
                            used_columns.intersection(range(column, column + cell.columns))
                        )
                    )
                )
                for row in located_rows
            )
            for located_rows in placed
        )
        return replace(
            self,
            heads=tuple(head for column, head in enumerate(self.heads) if column in used_columns),
            groups=groups,
        )


def _places(group: tuple[Row, ...]) -> list[list[tuple[int, Cell]]]:
    """Return each row's cells with their column numbers, allowing for cells that span rows."""
    rows: list[list[tuple[int, Cell]]] = []
    below: dict[int, int] = {}  # column -> number of further rows covered by a spanning cell
    for row in group:
        position, located = 0, []
        for cell in row:
            while below.get(position, 0):
                position += 1
            located.append((position, cell))
            below |= dict.fromkeys(range(position, position + cell.columns), cell.rows)
            position += cell.columns
        below = {column: left - 1 for column, left in below.items()}
        rows.append(located)
    return rows


@dataclass(frozen=True)
class Text:
    """Paragraph."""

    text: str


@dataclass(frozen=True)
class Entry:
    """One line of a record: labels of controllers, and text such as metrics and numbers."""

    names: tuple[str, ...] = ()
    text: str = ""

    @property
    def line(self) -> str:
        """Names and text, separated by a colon."""
        return ": ".join(filter(None, (", ".join(self.names), self.text)))


@dataclass(frozen=True)
class Record:
    """Fixed label with its entries."""

    label: str
    entries: tuple[Entry, ...] = (Entry(),)

    @property
    def line(self) -> str:
        """Label and entries on one line."""
        return ": ".join(filter(None, (self.label, "; ".join(e.line for e in self.entries))))


@dataclass(frozen=True, repr=False)
class Records:
    """Labelled records, which every medium prints in the same order."""

    records: tuple[Record, ...]

    def at(self, folder: str) -> "Records":
        """Return the records with the results ``folder`` in place of DIR in commands."""
        return Records(
            tuple(
                Record(
                    record.label,
                    tuple(
                        replace(entry, text=re.sub(r"\bDIR\b", lambda _: folder, entry.text))
                        for entry in record.entries
                    ),
                )
                for record in self.records
            )
        )

    def __repr__(self) -> str:
        """Return the records as text of at most 80 columns, with unbroken commands."""
        indent = max((len(record.label) for record in self.records), default=0) + 2
        lines = []
        for record in self.records:
            for k, entry in enumerate(record.entries):
                head = f"{'' if k else record.label:<{indent}}"
                text = re.sub(r"`[^`]*`", lambda code: code[0].replace(" ", "\0"), entry.line)
                width = _WIDTH - indent - 2
                first, *further = wrap(
                    text, width, break_long_words=False, break_on_hyphens=False
                ) or [""]
                lines += [f"{head}{first}".rstrip(), *(f"{'':{indent + 2}}{x}" for x in further)]
        return "\n".join(lines).replace("\0", " ")


def make_records(texts: Iterable[tuple[str, str]]) -> Records:
    """Return the records of labels with their texts; empty texts are omitted."""
    labelled: dict[str, list[Entry]] = {}
    for label, text in texts:
        if text:
            labelled.setdefault(label, []).append(Entry((), text))
    return Records(tuple(Record(label, tuple(entries)) for label, entries in labelled.items()))


@dataclass(frozen=True)
class Bullets:
    """List of sentences, one per line."""

    sentences: tuple[str, ...]


@dataclass(frozen=True)
class FigureText:
    """File name, title, caption and alternative text of a figure."""

    name: str  # file name without suffix
    title: str
    caption: str
    alt: str = "The caption and the tables describe this figure."  # description for screen readers


@dataclass(frozen=True)
class Picture:
    """Reference to a figure by name, which is ignored if the figure was not made."""

    name: str


@dataclass(frozen=True)
class Widget:
    """Interactive element of a page, identified by the name of its template."""

    name: str


@dataclass(frozen=True)
class Heading:
    """Heading within a section."""

    text: str


@dataclass(frozen=True)
class Fold:
    """Collapsible items, shown expanded in print."""

    title: str
    items: "tuple[Item, ...]"


Item: TypeAlias = Text | Records | Bullets | Table | Picture | Widget | Heading | Fold


@dataclass(frozen=True)
class Section:
    """Section of a topic, with its heading."""

    title: str
    items: tuple[Item, ...] = field(default=())
    part: bool = False  # whether the section belongs under the previous section's heading

    def without_idle(self) -> "Section":
        """Return the section with empty and all-zero columns removed from its tables."""
        return replace(self, items=_without_idle(self.items))

    def tables(self) -> list[Table]:
        """Return the section's tables, including folded ones."""
        return list(_tables_of(self.items))


def _tables_of(items: tuple[Item, ...]) -> Iterator[Table]:
    for item in items:
        if isinstance(item, Table):
            yield item
        elif isinstance(item, Fold):
            yield from _tables_of(item.items)


def _without_idle(items: tuple[Item, ...]) -> tuple[Item, ...]:
    return tuple(
        item.without_idle() if isinstance(item, Table)
        else replace(item, items=_without_idle(item.items)) if isinstance(item, Fold)
        else item
        for item in items
    )  # fmt: skip
