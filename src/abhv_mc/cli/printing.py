"""Output of commands: text, tables and JSON to standard output, warnings to stderr."""

import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import zip_longest
from pathlib import Path
from textwrap import fill, wrap
from typing import TYPE_CHECKING, Any, TextIO

from abhv_mc.compiling import listen
from abhv_mc.execution.progress import Waiting
from abhv_mc.folder.layout import write_text
from abhv_mc.io.messages import printable
from abhv_mc.process_settings import postpone_numpy_tools

if TYPE_CHECKING:
    from rich.table import Table

    from abhv_mc.topics.topic import Section
    from abhv_mc.topics.topic import Table as SectionTable

_COLORS = {
    "PASS": 32,
    "FAIL": 31,
    "NOT SHOWN": 33,
    "warning:": 33,
}  # ANSI colour codes of highlighted words
_KERNELS = {"flight": "the flight", "stability": "the stability margins", "laws": "the reference"}
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
    from abhv_mc.topics.formatting import json_data

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
    """Print a table; if it is too wide for the terminal, wrap its texts, and split it if necessary.

    The resulting tables repeat the first ``keys`` columns. Numbers are never truncated.
    """
    import io

    from rich.console import Console

    if table.title:  # rich would wrap the title to the width of the columns
        say(table.title, **options)
        table.title = None
    stream, terminal = io.StringIO(), shutil.get_terminal_size().columns
    plain: dict[str, Any] = dict.fromkeys(("markup", "emoji", "highlight"), False)
    Console(width=10_000, file=stream, color_system=None, **plain).print(table)
    lines = stream.getvalue().splitlines()
    is_limited = sys.stdout.isatty() or "COLUMNS" in os.environ
    if is_limited and max(map(len, lines), default=0) > terminal:
        lines = list(_fit_table(table, terminal, keys))
    say(*lines, sep="\n", folds=False, **options)


def _fit_table(table: "Table", terminal: int, keys: int) -> Iterator[str]:
    """Yield the lines of a table with wrapped texts, or of several narrower tables."""
    columns = [
        [str(column.header) * table.show_header, *map(str, column.cells)]
        for column in table.columns
    ]
    widths, wrapped = [], []
    for k, (head, *cells) in enumerate(columns):
        width = max((len(line) for cell in cells for line in cell.split("\n")), default=0)
        if table.columns[k].justify != "right" and width > _NARROWEST:
            width = _NARROWEST
            wrapped.append(k)
        widths.append(max(width, *map(len, head.split()), 1))
    for k in wrapped:
        widths[k] += max(0, terminal - sum(widths) - 2 * len(widths)) // len(wrapped)
    groups = [[*range(keys)]]
    for k in range(keys, len(widths)):
        if sum(widths[i] + 2 for i in (*groups[-1], k)) > terminal and len(groups[-1]) > keys:
            groups.append([*range(keys)])
        groups[-1].append(k)
    for group in groups:
        for row in zip(*(columns[k] for k in group), strict=True):
            pieces = [
                [piece for line in cell.split("\n") for piece in wrap(line, widths[k]) or [""]]
                for k, cell in zip(group, row, strict=True)
            ]
            for texts in zip_longest(*pieces, fillvalue=""):
                padded = (
                    text.rjust(widths[k])
                    if table.columns[k].justify == "right"
                    else text.ljust(widths[k])
                    for k, text in zip(group, texts, strict=True)
                )
                yield f"  {'  '.join(padded)}".rstrip()
        yield ""


def print_section_table(table: "SectionTable") -> None:
    """Print a table of a report section without its columns of commands, which are wide."""
    rows = table.plain_rows()
    visible = [
        k
        for k in range(len(table.heads))
        if not rows or any(row[k] and not row[k].startswith("`abhv-mc ") for row in rows)
    ]
    printed_table = new_table([table.heads[k] for k in visible], (), table.caption or table.title)
    for row in (row for group in table.groups for row in group):
        # A cell that spans several rows is printed only in the first of these rows.
        printed_table.add_row(*(row[k].plain.strip("`") * bool(row[k].rows) for k in visible))
    is_grouped = any(group[0][0].rows > 1 for group in table.groups if group)
    print_table(printed_table, keys=1 + (is_grouped and len(visible) > 2))


def print_section(section: "Section") -> None:
    """Print the sentences and tables of a report section, without collapsed content."""
    from abhv_mc.topics.topic import Records, Table

    for item in section.items:
        if isinstance(item, Records):
            say(item, folds=False)
        elif isinstance(item, Table):
            print_section_table(item)


def announce_compiling() -> None:
    """Enable messages on standard error about kernels that are being compiled."""
    postpone_numpy_tools()
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        message = "NUMBA_DISABLE_JIT is set: flights run uncompiled, a thousand times more slowly"
        say(f"warning: {message}", file=sys.stderr, flush=True)
    listen(_tell)


@contextmanager
def _tell(function: Any, by_other_process: bool) -> Iterator[None]:
    """Announce that a kernel is being compiled by this or another process."""
    group = function.__module__.removeprefix("abhv_mc_vehicle.kernel.").split(".")[0]
    action = "waiting for another process to compile" if by_other_process else "compiling"
    with Waiting(f"{action} {_KERNELS.get(group, 'a kernel')} for this machine"):
        yield


def announce_warnings(warnings: Iterable[str]) -> None:
    """Print each warning once to standard error."""
    for warning in dict.fromkeys(warnings):
        say(f"warning: {warning}", file=sys.stderr, flush=True)
