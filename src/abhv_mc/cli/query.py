"""``abhv-mc query``: SQL over a campaign's tables."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.printing import print_json, say

if TYPE_CHECKING:
    from duckdb import DuckDBPyRelation


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A campaign's folder, or its address.")],
    sql: Annotated[str, typer.Argument(metavar="SQL", help="For example: select count(*) from flights")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """Ask with SQL (duckdb); tables: flights, samples, histories, envelopes, nominal, reference.

    Parameters have a dot in their names: write them in double quotes, as in select "aero.lift" from samples.
    """
    from abhv_mc.folder.remote import fetched
    from abhv_mc.folder.sql import ask

    with fetched(folder) as source:
        if json or csv:
            rows = ask(source, sql, lambda answer: (answer.columns, answer.fetchall()))
            if rows is not None:
                _print_rows(*rows, json)
        else:
            say(ask(source, sql, _draw) or "", end="")


def _draw(answer: "DuckDBPyRelation") -> str:
    """The answer as a table of characters."""
    import contextlib
    import io

    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        answer.show(max_rows=200, max_width=200)
    return shown.getvalue()


def _print_rows(columns: list[str], rows: list[tuple[object, ...]], as_json: bool) -> None:
    """CSV as it is into a file or a pipe; on a terminal nothing that would move its cursor. Raises InputError."""
    import csv
    import sys

    from abhv_mc.io.input_error import InputError, printable
    from abhv_mc.report.numbers.plain import plain

    if as_json:
        twice = sorted({name for name in columns if columns.count(name) > 1})
        if twice:
            found = f"several columns named {', '.join(twice)}"
            raise InputError("query", None, None, found, "names of their own: select ... as ..., or --csv")
        print_json(plain([dict(zip(columns, row, strict=True)) for row in rows]))
    elif sys.stdout is not None:  # closed before the start
        if sys.stdout.isatty():
            rows = [tuple(printable(cell) if isinstance(cell, str) else cell for cell in row) for row in rows]
        csv.writer(sys.stdout, lineterminator="\n").writerows([columns, *rows])
