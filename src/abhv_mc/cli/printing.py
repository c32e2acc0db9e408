"""What commands print: JSON for programs, tables as wide as their text, in which no number is ever cut.

On standard error what a user should know beside: that code is compiled, what looks doubtful.
"""

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Any, TextIO

from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import write_text
from abhv_mc.io.input_error import printable

if TYPE_CHECKING:
    from rich.table import Table

    from abhv_mc.topics.section import Section
    from abhv_mc.topics.section import Table as SectionTable


_COLORS = {"PASS": 32, "FAIL": 31, "NOT SHOWN": 33, "warning:": 33}  # ANSI, of words on a terminal
_TIMES = "compiled.json"  # beside the folders of compiled code: seconds that each took last time on this machine
_PARTS = {
    "flight": "the flight",
    "stability": "a part of the stability margins",
    "laws": "the reference",
}
_NARROWEST = 16  # columns of a terminal, of folded words
_COLORED = re.compile(r"\b(?:PASS|FAIL|NOT SHOWN)\b|^warning:")


def say(*words: Any, sep: str = " ", folds: bool = True, **options: Any) -> None:
    """Print as Python's ``print``: no control characters, colours of verdicts, long sentences folded on a terminal."""
    text, file = printable(sep.join(map(str, words))), options.get("file") or sys.stdout
    if file is not None and file.isatty():
        width = shutil.get_terminal_size().columns
        text = "\n".join(_fold(line, width) if folds else line for line in text.split("\n"))
        if "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb":
            text = _COLORED.sub(lambda found: f"\x1b[{_COLORS[found[0]]}m{found[0]}\x1b[0m", text)
    print(text, **options)


def _fold(line: str, width: int) -> str:
    """Break a sentence that is wider than a terminal between words, but not within a command; leave rows of tables."""
    match: Any = re.fullmatch(r"(\s*(?:\S{1,12}\s{2,6})?)(.*)", line, re.DOTALL)
    label, text = match.groups()
    if len(line) <= width or "  " in text:
        return line
    whole = re.sub(r"`[^`]*`", lambda command: command[0].replace(" ", "\0"), text)
    indent = " " * len(label)
    folded = fill(whole, width - len(label), break_long_words=False, break_on_hyphens=False)
    return label + folded.replace("\n", f"\n{indent}").replace("\0", " ")


def beside(file: Path | None) -> TextIO | None:
    """Where to say what stands beside figures: on standard error where these go to standard output."""
    return sys.stderr if file == Path("-") else None


def answer(figures: Any, file: Path | None, in_words: Callable[[], None]) -> None:
    """Print figures in words, and write them as JSON where asked for; ``-`` has the JSON alone on standard output.

    Infinite and missing numbers are null.
    """
    from abhv_mc.topics.plain import plain

    if file != Path("-"):
        in_words()
    if file is None:
        return
    text = json.dumps(plain(figures), indent=2, default=str, allow_nan=False) + "\n"
    if file == Path("-"):
        print(text, end="")
    else:
        write_text(file, text)


def new_table(
    left: Iterable[str], right: Iterable[str], title: str | None = None, **options: Any
) -> "Table":
    """An empty table: headings of columns of words, then of columns of numbers. ``options`` are those of rich."""
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
    """Print a table; one wider than the terminal has its words folded, then its columns in several tables.

    Numbers are never cut; the first ``keys`` columns are repeated.
    """
    import io

    from rich.console import Console
    from rich.measure import Measurement

    console = Console()
    wide = console.options.update(width=1000)
    width = Measurement.get(console, wide, table).maximum
    terminal = shutil.get_terminal_size().columns
    tables = [(table, width)]
    if (sys.stdout.isatty() or "COLUMNS" in os.environ) and width > terminal:
        tables = list(_fit_table(table, terminal, keys))
    text = io.StringIO()
    for part, columns in tables:
        Console(
            width=columns,
            file=text,
            color_system=None,
            markup=False,
            emoji=False,
            highlight=False,
        ).print(part)
    say(text.getvalue(), end="", folds=False, **options)


def _fit_table(table: "Table", terminal: int, keys: int) -> Iterator[tuple["Table", int]]:
    """Yield the table with folded columns and its width; if too wide, in parts that repeat its first columns."""
    from dataclasses import replace

    widths = []
    for column in table.columns:
        cells = [part for cell in column.cells for part in str(cell).split("\n")]
        natural = max(map(len, cells), default=0)
        words = max(map(len, str(column.header).split()), default=0)
        column.no_wrap = column.justify == "right" or natural <= _NARROWEST
        column.min_width = max(natural if column.no_wrap else _NARROWEST, words)
        if column.no_wrap:
            lines = str(column.header).split("\n")
            column.header = "\n".join(fill(line, column.min_width) for line in lines)
        column.overflow = "fold"
        widths.append(column.min_width + 2)
    repeated, first = [*range(keys)], sum(widths[:keys]) + 2
    parts, used, needed = [[*repeated]], first, terminal
    for k, width in enumerate(widths[keys:], start=keys):
        if used + width > terminal and len(parts[-1]) > keys:
            parts.append([*repeated])
            used = first
        parts[-1].append(k)
        used += width
        needed = max(needed, used)
    if len(parts) == 1:
        yield table, needed
        return
    for part, chosen in enumerate(parts):
        columns = [table.columns[k] for k in chosen]
        shown = new_table((), (), box=table.box)
        shown.title = None if part else table.title
        shown.columns = [
            replace(column, _index=at, _cells=list(column.cells))
            for at, column in enumerate(columns)
        ]
        shown.rows = list(table.rows)
        yield shown, needed


def print_section_table(table: "SectionTable") -> None:
    """Print a table of a topic's section, without its commands, which are wider than a terminal."""
    rows = table.plain_rows()
    kept = [
        k
        for k in range(len(table.heads))
        if not (rows and all(row[k].startswith("`abhv-mc ") or not row[k] for row in rows))
    ]
    drawn = new_table([table.heads[k] for k in kept], (), table.caption or table.title)
    notes = []  # rows of one cell over several columns
    lines = iter(rows)
    for group in table.groups:
        for number, cells in enumerate(group):
            row = next(lines)
            if any(cell.columns > 1 for cell in cells):
                notes.append(": ".join(dict.fromkeys(row)))
                continue
            # A cell that stands for several rows is printed in its first one.
            spans = [cell.rows for cell in group[0]]
            spans += [1] * (len(table.heads) - len(spans))
            drawn.add_row(*("" if 0 < number < spans[k] else row[k].strip("`") for k in kept))
    is_grouped = any(group[0][0].rows > 1 for group in table.groups if group)
    print_table(drawn, keys=1 + (is_grouped and len(kept) > 2))
    say(*notes, sep="\n", end="\n" * bool(notes))


def print_section(section: "Section") -> None:
    """Print the sentences and tables of a section but those that it folds."""
    from abhv_mc.topics.section import Bullets, Lead, Table

    for item in section.items:
        if isinstance(item, Bullets | Lead):
            say(*item.sentences, sep="\n")
        elif isinstance(item, Table):
            print_section_table(item)


def announce_compiling() -> None:
    """From here on, tell standard error what is compiled instead of found in the cache, or waited for, and how long."""
    from abhv_mc.kernel.jit import PLAIN, set_compile_listener

    if PLAIN:
        words = "NUMBA_DISABLE_JIT is set: nothing is compiled, and flights take thousands of times as long"
        say(f"warning: {words}", file=sys.stderr, flush=True)
    set_compile_listener(_tell)


@contextmanager
def _tell(function: Any, elsewhere: bool) -> Iterator[None]:
    """While a kernel is compiled, here or by another process that is waited for."""
    from abhv_mc.kernel.cache import cache_root

    part = _PARTS.get(function.__module__.removeprefix("abhv_mc.kernel.").split(".")[0], "a part")
    if elsewhere:
        with Waiting(f"waiting for another process, which compiles {part}"):
            yield
        return
    file, name = (
        cache_root() / _TIMES,
        f"{function.__module__}.{function.__name__}",
    )
    try:
        times = json.loads(file.read_text())
        before = f"; {times[name]:.0f} s last time" if name in times else ""
    except (OSError, ValueError):
        times, before = {}, ""
    with Waiting(
        f"compiling {part} for this machine (once per kind of campaign{before})"
    ) as waiting:
        yield
    with suppress(OSError):
        file.write_text(json.dumps(times | {name: round(waiting.seconds, 1)}))


def announce_warnings(warnings: Iterable[str]) -> None:
    """What deserves a second look about the mission of these flights, each sentence once."""
    for warning in dict.fromkeys(warnings):
        say(f"warning: {warning}", file=sys.stderr, flush=True)
