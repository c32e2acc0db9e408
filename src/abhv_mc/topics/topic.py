"""Report topic with its numbers, section and figures, and the printed names of a campaign.

A section is data, to be shown on a page, in a terminal or in a notebook. Text between backticks
is literal, such as a command, a file name or a key.
"""

import os
import re
import shlex
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from itertools import compress
from math import isfinite
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

from abhv_mc.campaign.file.experiment import Experiment, Requirement
from abhv_mc.entry_points import TOPICS, find_entry_points
from abhv_mc.flights.metrics import Metric
from abhv_mc.folder.flown_campaign import FlownCampaign
from abhv_mc.folder.inputs import content_of
from abhv_mc.io.messages import InputError, found_value
from abhv_mc.shipped import shipped_files
from abhv_mc.statistics.estimates import Interval
from abhv_mc.topics.formatting import bounds, estimate

if TYPE_CHECKING:
    from matplotlib.figure import Figure

M = TypeVar("M")
# name, title and caption of a figure, and the figure
Drawn: TypeAlias = "tuple[FigureText, Figure]"

_INITIALS = ("tlc", "lqr")
_WIDTH = 80  # maximum line width of printed records, in columns
_IDLE = {"", "0", "\N{EM DASH}"}


@dataclass(frozen=True)
class Cell:
    """Cell of a table."""

    text: str
    note: str = ""  # small text next to the value, such as an interval
    rows: int = 1  # number of rows that the cell spans; 0 for its repetitions in these rows
    head: bool = False  # whether the cell is a row header
    verdict: bool = False  # whether the cell is a verdict: PASS, FAIL, NOT SHOWN or ESTIMATE
    # controller and number of the flight that a click on the cell shows
    flight: tuple[str, int] | None = None
    hint: str = ""  # tooltip
    best: bool = False  # whether the cell is bold on a page, and marked by * in text

    @property
    def plain(self) -> str:
        """Text with the note in parentheses."""
        return f"{self.text}{'*' * self.best}{f' ({self.note})' if self.note else ''}"


def interval_cell(interval: Interval) -> Cell:
    """Return an estimate with its interval, or 'not reached' if it is infinite."""
    if not isfinite(interval.value):
        return Cell("not reached")
    return Cell(estimate(interval), bounds(interval))


Row: TypeAlias = tuple[Cell, ...]


def make_row(head: str, *texts: str) -> Row:
    """Return a row of a header cell and further cells of text."""
    return (Cell(head, head=True), *map(Cell, texts))


def grouped(rows: Sequence[Row], *heads: Cell) -> tuple[Row, ...]:
    """Return the rows, preceded by header cells that span all rows."""
    return tuple(
        (*(replace(head, rows=0 if k else len(rows)) for head in heads), *row)
        for k, row in enumerate(rows)
    )


@dataclass(frozen=True)
class Table:
    """Table whose rows form groups; the first cells of a group may span its rows."""

    title: str
    heads: tuple[str, ...]
    groups: tuple[tuple[Row, ...], ...]
    caption: str = ""  # text above the table in addition to the title
    numbers: bool = True  # whether most cells are numbers

    def plain_rows(self) -> list[list[str]]:
        """Return all cells as text, each repeated in the rows that it spans."""
        return [[cell.plain for cell in row] for group in self.groups for row in group]

    def without_constant(self) -> "Table":
        """Return the table with its constant columns moved to the caption.

        Row headers are kept, and a table with a single row is unchanged.
        """
        columns = self._columns()
        varies = [
            len(cells) == 1 or cells[0].head or len({cell.text for cell in cells}) > 1
            for cells in columns
        ]
        texts = [
            f"{head}: {cells[0].text}"
            for head, cells, is_varying in zip(self.heads, columns, varies, strict=True)
            if not is_varying and cells[0].text not in _IDLE
        ]
        caption = f"{self.caption or self.title}. In all rows: {'; '.join(texts)}"
        return replace(self._select(varies), caption=caption if texts else self.caption)

    def without_idle(self) -> "Table":
        """Return the table without columns whose cells are all empty or zero."""
        is_used = [
            any(cell.head or cell.note or cell.text not in _IDLE for cell in cells)
            for cells in self._columns()
        ]
        return self._select(is_used) if self.groups else self

    def _columns(self) -> list[Row]:
        return list(zip(*(row for group in self.groups for row in group), strict=True))

    def _select(self, is_used: Sequence[bool]) -> "Table":
        groups = (tuple(tuple(compress(row, is_used)) for row in group) for group in self.groups)
        return replace(self, heads=tuple(compress(self.heads, is_used)), groups=tuple(groups))


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
        records = []
        for record in self.records:
            texts = (re.sub(r"\bDIR\b", lambda _: folder, entry.text) for entry in record.entries)
            entries = map(Entry, (entry.names for entry in record.entries), texts)
            records.append(Record(record.label, tuple(entries)))
        return Records(tuple(records))

    def __repr__(self) -> str:
        """Return the records as text of at most 80 columns, with unbroken commands."""
        indent = max((len(record.label) for record in self.records), default=0) + 2
        lines = []
        for record in self.records:
            for k, entry in enumerate(record.entries):
                head = f"{'' if k else record.label:<{indent}}"
                text = re.sub(r"`[^`]*`", lambda code: code[0].replace(" ", "\0"), entry.line)
                first, *further = wrap(
                    text, _WIDTH - indent - 2, break_long_words=False, break_on_hyphens=False
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
class FigureText:
    """File name, title and caption of a figure."""

    name: str  # file name without suffix
    title: str
    caption: str


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


Item: TypeAlias = Text | Records | Table | Picture | Widget | Heading | Fold


@dataclass(frozen=True)
class Section:
    """Section of a topic, with its heading."""

    title: str
    items: tuple[Item, ...] = ()
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


def controller_label(name: str) -> str:
    """Return a controller's printed name, such as 'LQR robust' for 'lqr_robust'."""
    base, *entries = name.split("+")  # entries of a variant
    words = (word.upper() if word in _INITIALS else word for word in base.split("_"))
    return " ".join((*words, *entries))


def full_labels(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the printed names of a campaign's controllers; the LQR of the paper is marked."""
    paper = content_of(shipped_files("control")["lqr"])
    flown = {name: folder / "inputs" / "controllers" / name / "lqr.yaml" for name in names}
    return {
        name: controller_label(name)
        + (" (paper's weights)" if path.is_file() and content_of(path) == paper else "")
        for name, path in flown.items()
    }


@dataclass(frozen=True)
class Names:
    """Printed names of a campaign's controllers and metrics, with the campaign's results."""

    controllers: Mapping[str, str]  # controller -> label, in the campaign's order
    metrics: Mapping[str, Metric]  # metric records by name
    asked: tuple[str, ...]  # names of the leading metrics
    requirements: tuple[Requirement, ...]
    folder: str
    campaign: Experiment
    results: FlownCampaign = field(repr=False)

    @property
    def kind(self) -> str:
        """Heading of columns of controllers, such as 'Controller'."""
        return self.campaign.kind.capitalize()

    def label(self, controller: str) -> str:
        """Return a controller's printed name."""
        return self.controllers.get(controller, controller)


def names_of(results: FlownCampaign, page: Path | None = None) -> Names:
    """Return a campaign's names; the results folder is relative to folder ``page``, if given."""
    campaign, target = results.campaign, results.folder
    if page is not None:
        target = Path(os.path.relpath(target.absolute(), page.absolute()))
    return Names(
        controllers=full_labels(results.folder, results.controllers),
        metrics=campaign.metrics,
        asked=results.asked,
        requirements=campaign.requirements,
        folder=shlex.quote(target.as_posix()),
        campaign=campaign,
        results=results,
    )


def figures_of(room: str) -> Callable[[Any, Names], Iterator[Drawn]]:
    """Return a function that makes the figures defined in a package's ``figures`` module.

    The module and matplotlib are imported on the first call.
    """

    def draw(model: Any, names: Names) -> Iterator[Drawn]:
        yield from import_module(f"{room}.figures").draw(model, names)

    return draw


@dataclass(frozen=True)
class Topic(Generic[M]):
    """Report topic whose ``compute`` returns a model, a frozen dataclass of numbers.

    The section and figures are made from the model and :class:`Names`, which also gives
    access to the campaign and its results.
    """

    # name of the topic in report.json, in `abhv-mc show NAME DIR` and in the results
    name: str
    model: type[M]
    compute: Callable[[FlownCampaign], M]
    section: Callable[[M, Names], Section | None]  # section, or None if there is nothing to report
    figures: Callable[[M, Names], Iterator[Drawn]] = lambda _model, _names: iter(())


class Models:
    """Models of a campaign's topics, each computed on first use."""

    def __init__(self, results: FlownCampaign, page: Path | None = None) -> None:
        """Prepare the models; printed commands contain the results folder relative to ``page``."""
        self.results = results
        self._page = page
        self._held: dict[str, Any] = {}

    @cached_property
    def names(self) -> Names:
        """Names of the campaign's controllers and metrics."""
        return names_of(self.results, self._page)

    def __getitem__(self, topic: Topic[M]) -> M:
        if topic.name not in self._held:
            self._held[topic.name] = topic.compute(self.results)
        model: M = self._held[topic.name]
        return model

    @cached_property
    def users(self) -> tuple["Topic[Any]", ...]:
        """Custom topics that do not fail for this campaign; failures are reported on stderr."""
        topics = []
        for topic in user_topics():
            try:
                self.section(topic)
            except Exception:
                _tell_failure(topic.name)
            else:
                topics.append(topic)
        return tuple(topics)

    def section(self, topic: Topic[Any]) -> Section | None:
        """Return a topic's section."""
        section = topic.section(self[topic], self.names)
        return section and section.without_idle()

    def figures(self, topic: Topic[Any]) -> Iterator[Drawn]:
        """Yield a topic's figures with their file names, titles and captions."""
        return topic.figures(self[topic], self.names)


REGISTERED: dict[str, Topic[Any]] = {}  # custom topics registered in this process


def user_topics() -> tuple[Topic[Any], ...]:
    """Return the custom topics of installed packages and notebooks that can be imported.

    Raise InputError for an entry point that is not a topic.
    """
    topics = {}
    for entry in find_entry_points(TOPICS).values():
        try:
            topic = entry.load()
        except Exception:
            _tell_failure(entry.name)
            continue
        if not isinstance(topic, Topic):
            raise InputError(
                f"entry point {entry.name} of {TOPICS}",
                found_value(topic),
                "an abhv_mc.topics.Topic",
            )
        topics[topic.name] = topic
    return tuple({**topics, **REGISTERED}.values())


def _tell_failure(name: str) -> None:
    """Report on stderr that a custom topic failed and is omitted."""
    print(
        f"the topic {name} failed and is left out of the report:\n{traceback.format_exc()}",
        end="",
        file=sys.stderr,
        flush=True,
    )
