"""A section of a report as values: what a topic has to say, for a page, a terminal or a notebook to draw.

In every text, what stands between backticks is typed as it stands: a command, a file, a key.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from typing import TypeAlias

from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.words import bounds, estimate

_IDLE = {"", "0", "\N{EM DASH}"}


@dataclass(frozen=True)
class Cell:
    """One cell of a table."""

    text: str
    note: str = ""  # in small type beside it: an interval, 'binding'
    rows: int = 1  # how many rows it stands for, its own the first; the rows below leave it out
    columns: int = 1
    head: bool = False  # whether it says what its row is
    verdict: bool = False  # whether it is one of PASS, FAIL, NOT SHOWN, ESTIMATE
    flight: tuple[str, int] | None = (
        None  # controller and number of the flight that the page shows at a click
    )
    hint: str = ""  # what it means, for whoever points at it


def interval_cell(interval: Interval) -> Cell:
    """An estimate with its interval; says where too many flights were lost for one."""
    return (
        Cell(estimate(interval), bounds(interval))
        if isfinite(interval.value)
        else Cell("not reached")
    )


Row: TypeAlias = tuple[Cell, ...]


def grouped(rows: Sequence[Row], *heads: Cell) -> tuple[Row, ...]:
    """Rows behind cells that stand for all of them."""
    return ((*(replace(head, rows=len(rows)) for head in heads), *rows[0]), *rows[1:])


@dataclass(frozen=True)
class Table:
    """A table; rows that share a cell over several of them are one group."""

    title: str
    heads: tuple[str, ...]
    groups: tuple[tuple[Row, ...], ...]
    caption: str = ""  # what stands above it, where the title does not say it all
    numbers: bool = True  # whether its cells are mostly numbers

    def plain_rows(self) -> list[list[str]]:
        """Every cell as text, those that stand for several rows or columns repeated."""
        rows: list[list[str]] = []
        for group in self.groups:
            lines = [[""] * len(self.heads) for _ in group]
            for r, places in enumerate(_places(group)):
                for at, cell in places:
                    words = f"{cell.text} ({cell.note})" if cell.note else cell.text
                    for line in lines[r : r + cell.rows]:
                        line[at : at + cell.columns] = [words] * cell.columns
            rows += lines
        return rows

    def without_constant(self) -> "Table":
        """Return the table with columns of one text moved into its caption; single rows and heads stay."""
        (rows,) = self.groups
        texts = {at: {row[at].text for row in rows} for at in range(len(self.heads))}
        constant = {
            at: found.pop()
            for at, found in texts.items()
            if len(rows) > 1 and len(found) == 1 and not rows[0][at].head
        }
        told = [f"{self.heads[at]}: {text}" for at, text in constant.items() if text not in _IDLE]
        caption = f"{self.caption or self.title}. Of all rows: {'; '.join(told)}"
        return replace(
            self,
            heads=tuple(head for at, head in enumerate(self.heads) if at not in constant),
            groups=(
                tuple(
                    tuple(cell for at, cell in enumerate(row) if at not in constant) for row in rows
                ),
            ),
            caption=caption if told else self.caption,
        )

    def without_idle(self) -> "Table":
        """Without the columns that are empty or zero throughout."""
        placed = [_places(group) for group in self.groups]
        told = {
            at
            for places in placed
            for row in places
            for at, cell in row
            if cell.head or cell.note or (cell.columns == 1 and cell.text not in _IDLE)
        }
        if len(told) == len(self.heads) or not self.groups:
            return self
        groups = tuple(
            tuple(
                tuple(
                    replace(cell, columns=width)
                    for at, cell in row
                    if (width := len(told.intersection(range(at, at + cell.columns))))
                )
                for row in places
            )
            for places in placed
        )
        return replace(
            self,
            heads=tuple(head for at, head in enumerate(self.heads) if at in told),
            groups=groups,
        )


def _places(group: tuple[Row, ...]) -> list[list[tuple[int, Cell]]]:
    """Each row's cells with their columns, beside those that come down from rows above."""
    rows: list[list[tuple[int, Cell]]] = []
    below: dict[int, int] = {}  # column -> rows that a cell from above still takes
    for row in group:
        at, places = 0, []
        for cell in row:
            while below.get(at, 0):
                at += 1
            places.append((at, cell))
            below |= dict.fromkeys(range(at, at + cell.columns), cell.rows)
            at += cell.columns
        below = {column: left - 1 for column, left in below.items()}
        rows.append(places)
    return rows


@dataclass(frozen=True)
class Text:
    """A paragraph."""

    text: str


@dataclass(frozen=True)
class Lead:
    """The judgement in words, first of all: nothing else is printed in bold."""

    answer: str
    because: tuple[str, ...] = ()
    sure: str = ""
    next: str = ""

    @property
    def sentences(self) -> tuple[str, ...]:
        """All of it, a sentence each."""
        return tuple(filter(None, (self.answer, *self.because, self.sure, self.next)))


@dataclass(frozen=True)
class Bullets:
    """Sentences, one a line."""

    sentences: tuple[str, ...]


@dataclass(frozen=True)
class FigureText:
    """A figure's file name and words."""

    name: str  # of the file, without its suffix
    title: str
    caption: str
    alt: str = "The caption and the tables say what it shows."  # for who cannot see it


@dataclass(frozen=True)
class Picture:
    """Where one of the topic's figures stands, by its name; nothing where that was not made."""

    name: str


@dataclass(frozen=True)
class Widget:
    """What a page alone can show, by the name of its template."""

    name: str


@dataclass(frozen=True)
class Heading:
    """A heading within the section."""

    text: str


@dataclass(frozen=True)
class Fold:
    """What a reader opens who wants it; printed open on paper."""

    title: str
    items: "tuple[Item, ...]"


Item: TypeAlias = Text | Lead | Bullets | Table | Picture | Widget | Heading | Fold


@dataclass(frozen=True)
class Section:
    """What a topic says, under its heading."""

    title: str
    items: tuple[Item, ...] = field(default=())
    part: bool = False  # whether it stands under the heading of the section before

    def without_idle(self) -> "Section":
        """The same, its tables without columns that are empty or zero throughout."""
        return replace(self, items=_without_idle(self.items))

    def tables(self) -> list[Table]:
        """Its tables, folded ones too."""
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
