"""Output of commands: text, tables and JSON to standard output, warnings to stderr."""

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import LazyLoader, find_spec, module_from_spec
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, TextIO

from abhv_mc.compiling import listen
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import write_text
from abhv_mc.io.input_error import printable

if TYPE_CHECKING:
    from rich.table import Table

    from abhv_mc.topics.section import Section
    from abhv_mc.topics.section import Table as SectionTable


_COLORS = {
    "PASS": 32,
    "FAIL": 31,
    "NOT SHOWN": 33,
    "warning:": 33,
}  # ANSI colour codes of highlighted words
_TIMES = "compiled.json"  # cache file with the compilation times of kernels on this machine, in s
_KERNELS = {
    "flight": "the flight",
    "stability": "the stability margins",
    "laws": "the reference",
}
_NARROWEST = 16  # minimum width of a wrapped text column
_COLORED = re.compile(r"\b(?:PASS|FAIL|NOT SHOWN)\b|^warning:")


def say(*values: Any, sep: str = " ", folds: bool = True, **options: Any) -> None:
    """Print text like the built-in ``print``, with control characters escaped.

    On a terminal, verdicts are coloured and long sentences are wrapped.
    """
    text, file = printable(sep.join(map(str, values))), options.get("file") or sys.stdout
    if file is not None and file.isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(_fold(line, width) if folds else line for line in text.split("\n"))
        if "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb":
            text = _COLORED.sub(lambda match: f"\x1b[{_COLORS[match[0]]}m{match[0]}\x1b[0m", text)
    print(text, **options)


def _fold(line: str, width: int) -> str:
    """Wrap a line to the width of the terminal, except commands and table rows."""
    match: Any = re.fullmatch(r"(\s*(?:\S{1,12}\s{2,6})?)(.*)", line, re.DOTALL)
    label, text = match.groups()
    if len(line) <= width or "  " in text:
        return line
    unbroken = re.sub(r"`[^`]*`", lambda command: command[0].replace(" ", "\0"), text)
    indent = " " * len(label)
    folded = fill(unbroken, width - len(label), break_long_words=False, break_on_hyphens=False)
    return label + folded.replace("\n", f"\n{indent}").replace("\0", " ")


def text_stream(file: Path | None) -> TextIO | None:
    """Return the stream for text: standard error if JSON goes to standard output."""
    return sys.stderr if file == Path("-") else None


def show_result(result: Any, file: Path | None, print_text: Callable[[], None]) -> None:
    """Print a result as text, and write it as JSON to ``file`` if given.

    If ``file`` is ``-``, only JSON is printed to standard output. Infinite and missing numbers are
    null.
    """
    from abhv_mc.topics.json_data import json_data

    if file != Path("-"):
        print_text()
    if file is None:
        return
    text = json.dumps(json_data(result), indent=2, default=str, allow_nan=False) + "\n"
    if file == Path("-"):
        print(text, end="")
    else:
        write_text(file, text)


def new_table(
    left: Iterable[str], right: Iterable[str], title: str | None = None, **options: Any
) -> "Table":
    """Return an empty table with headings for text columns and number columns.

    ``options`` are options of ``rich.table.Table``.
    """
    from rich.box import ASCII, SIMPLE
    from rich.table import Table

    is_unicode = (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    table = Table(title=title, **{"box": SIMPLE if is_unicode else ASCII, **options})
    for heading in left:
        table.add_column(heading, no_wrap=True)
    for heading in right:
        table.add_column(heading, justify="right", no_wrap=True)
    return table


def print_table(table: "Table", keys: int = 1, **options: Any) -> None:
    """Print a table; if it is too wide for the terminal, print its first column as headings.

    A table that is still too wide is wrapped or split into several tables, each of which repeats
    the first ``keys`` columns. Numbers are never truncated.
    """
    import io

    from rich.console import Console
    from rich.measure import Measurement

    if table.title:  # rich would wrap the title to the width of the columns
        say(table.title, **options)
        table.title = None
    console = Console()
    wide = console.options.update(width=1000)
    width = Measurement.get(console, wide, table).maximum
    terminal = shutil.get_terminal_size().columns
    tables = [(table, width)]
    if (sys.stdout.isatty() or "COLUMNS" in os.environ) and width > terminal:
        lines = _lines_with_headings(table, terminal, keys)
        if lines:
            say(*lines, sep="\n", folds=False, **options)
            return
        tables = list(_fit_table(table, terminal, keys))
    text = io.StringIO()
    for piece, columns in tables:
        Console(
            width=columns,
            file=text,
            color_system=None,
            markup=False,
            emoji=False,
            highlight=False,
        ).print(piece)
    say(text.getvalue(), end="", folds=False, **options)


def _lines_with_headings(table: "Table", terminal: int, keys: int) -> list[str]:
    """Return the lines of a table whose first column is printed as headings above the rows.

    The remaining columns are split into groups that fit the terminal; each group repeats the first
    ``keys`` columns. The list is empty if the entries of the first column are short, or if a row
    does not fit on a line.
    """
    columns = [[str(cell) for cell in column.cells] for column in table.columns]
    longest = max(map(len, columns[0]), default=0) if columns else 0
    if not (table.show_header and longest > _NARROWEST and len(columns) > 1):
        return []
    heads, widths = [], []
    for column, texts in zip(table.columns, columns, strict=True):
        widths.append(max(map(len, (*texts, *str(column.header).split()))))
        heads.append(fill(str(column.header), max(widths[-1], 1)).split("\n"))
    repeated = [*range(1, keys)]
    pieces = [[*repeated]]
    for k in range(keys, len(columns)):
        if sum(widths[i] + 2 for i in [*pieces[-1], k]) > terminal and pieces[-1] != repeated:
            pieces.append([*repeated])
        pieces[-1].append(k)
    is_cut = any("\n" in text for texts in columns for text in texts)
    if is_cut or any(sum(widths[k] + 2 for k in piece) > terminal for piece in pieces):
        return []

    def line(texts: Iterable[str], piece: list[int]) -> str:
        padded = (
            f"{text:>{widths[k]}}"
            if table.columns[k].justify == "right"
            else f"{text:<{widths[k]}}"
            for text, k in zip(texts, piece, strict=True)
        )
        return f"  {'  '.join(padded)}".rstrip()

    lines: list[str] = []
    for piece in pieces:
        lines += filter(None, [str(table.columns[0].header)])
        height = max(len(heads[k]) for k in piece)
        shown = [[""] * (height - len(heads[k])) + heads[k] for k in piece]
        lines += [line(texts, piece) for texts in zip(*shown, strict=True)]
        for number, heading in enumerate(columns[0]):
            lines += [fill(heading, terminal, subsequent_indent="  ")] if heading else []
            lines.append(line((columns[k][number] for k in piece), piece))
        lines.append("")
    return lines


def _fit_table(table: "Table", terminal: int, keys: int) -> Iterator[tuple["Table", int]]:
    """Yield a wrapped table and its width, or several narrower tables if it is too wide.

    Each of the narrower tables repeats the first ``keys`` columns.
    """
    from dataclasses import replace

    widths = []
    for column in table.columns:
        cells = [line for cell in column.cells for line in str(cell).split("\n")]
        natural = max(map(len, cells), default=0)
        longest_word = max(map(len, str(column.header).split()), default=0)
        column.no_wrap = column.justify == "right" or natural <= _NARROWEST
        column.min_width = max(natural if column.no_wrap else _NARROWEST, longest_word)
        if column.no_wrap:
            lines = str(column.header).split("\n")
            column.header = "\n".join(fill(line, column.min_width) for line in lines)
        column.overflow = "fold"
        widths.append(column.min_width + 3)  # with padding and divider
    repeated, first = [*range(keys)], sum(widths[:keys]) + 1
    groups, used, needed = [[*repeated]], first, terminal
    for k, width in enumerate(widths[keys:], start=keys):
        if used + width > terminal and len(groups[-1]) > keys:
            groups.append([*repeated])
            used = first
        groups[-1].append(k)
        used += width
        needed = max(needed, used)
    if len(groups) == 1:
        yield table, needed
        return
    for group in groups:
        columns = [table.columns[k] for k in group]
        piece = new_table((), (), box=table.box)
        piece.columns = [
            replace(column, _index=index, _cells=list(column.cells))
            for index, column in enumerate(columns)
        ]
        piece.rows = list(table.rows)
        yield piece, needed


def print_section_table(table: "SectionTable") -> None:
    """Print a table of a report section without its columns of commands, which are wide."""
    rows = table.plain_rows()
    visible = [
        k
        for k in range(len(table.heads))
        if not (rows and all(row[k].startswith("`abhv-mc ") or not row[k] for row in rows))
    ]
    printed_table = new_table([table.heads[k] for k in visible], (), table.caption or table.title)
    notes = []  # contents of cells that span several columns
    lines = iter(rows)
    for group in table.groups:
        for number, cells in enumerate(group):
            row = next(lines)
            if any(cell.columns > 1 for cell in cells):
                notes.append(": ".join(dict.fromkeys(row)))
                continue
            # A cell that spans several rows is printed only in the first of these rows.
            spans = [cell.rows for cell in group[0]]
            spans += [1] * (len(table.heads) - len(spans))
            printed_table.add_row(
                *("" if 0 < number < spans[k] else row[k].strip("`") for k in visible)
            )
    is_grouped = any(group[0][0].rows > 1 for group in table.groups if group)
    print_table(printed_table, keys=1 + (is_grouped and len(visible) > 2))
    say(*notes, sep="\n", end="\n" * bool(notes))


def print_section(section: "Section") -> None:
    """Print the sentences and tables of a report section, without collapsed content."""
    from abhv_mc.topics.section import Bullets, Records, Table

    for item in section.items:
        if isinstance(item, Bullets):
            say(*item.sentences, sep="\n")
        elif isinstance(item, Records):
            say(item, folds=False)
        elif isinstance(item, Table):
            print_section_table(item)


def announce_compiling() -> None:
    """Enable messages on standard error about kernels that are being compiled."""
    _postpone_tools()
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        message = "NUMBA_DISABLE_JIT is set: flights run uncompiled, a thousand times more slowly"
        say(f"warning: {message}", file=sys.stderr, flush=True)
    listen(_tell)


def _postpone_tools() -> None:
    """Load two packages of numpy on first use; scipy.special would import them without need."""
    import numpy as np

    for name in {"f2py", "testing"} - vars(np).keys():
        spec: Any = find_spec(f"numpy.{name}")
        spec.loader = LazyLoader(spec.loader)
        sys.modules[spec.name] = module = module_from_spec(spec)
        spec.loader.exec_module(module)
        setattr(np, name, module)


@contextmanager
def _tell(function: Any, by_other_process: bool) -> Iterator[None]:
    """Announce that a kernel is being compiled by this or another process."""
    from abhv_mc.cache_root import cache_root

    group = function.__module__.removeprefix("abhv_mc_vehicle.kernel.").split(".")[0]
    kernel = _KERNELS.get(group, "a kernel")
    if by_other_process:
        with Waiting(f"waiting for another process to compile {kernel}"):
            yield
        return
    file = cache_root() / _TIMES
    name = f"{function.__module__}.{function.__name__}"
    try:
        times = json.loads(file.read_text())
        last_time = f"; {times[name]:.0f} s last time" if name in times else ""
    except (OSError, ValueError):
        times, last_time = {}, ""
    with Waiting(
        f"compiling {kernel} for this machine (once per kind of campaign{last_time})"
    ) as waiting:
        yield
    with suppress(OSError):
        file.write_text(json.dumps(times | {name: round(waiting.seconds, 1)}))


def announce_warnings(warnings: Iterable[str]) -> None:
    """Print each warning once to standard error."""
    for warning in dict.fromkeys(warnings):
        say(f"warning: {warning}", file=sys.stderr, flush=True)
