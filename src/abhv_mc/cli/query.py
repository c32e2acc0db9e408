"""``abhv-mc query``: SQL over a campaign's tables."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A campaign's folder, or its address.")],
    sql: Annotated[str, typer.Argument(metavar="SQL", help="For example: select count(*) from flights")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="Print CSV.")] = False,
) -> None:
    """Ask with SQL (duckdb); tables: flights, samples, histories, envelopes, nominal, reference.

    Parameters have a dot in their names: write them in double quotes, as in select "aero.lift" from samples.
    """
    import contextlib
    import io

    import duckdb

    from abhv_mc.io.input_error import InputError
    from abhv_mc.store.database import open_database
    from abhv_mc.store.remote import fetched

    with fetched(folder) as source:
        connection = open_database(source)
        try:
            answer = connection.sql(sql)
            if answer is None:
                return
            if json or csv:
                _print_rows(answer.columns, answer.fetchall(), json)
            else:
                shown = io.StringIO()
                with contextlib.redirect_stdout(shown):
                    answer.show(max_rows=200, max_width=200)
                say(shown.getvalue(), end="")
        except duckdb.Error as error:
            words = str(error).partition("\nTraceback")[0]  # duckdb adds one where Python lacks what a type needs
            raise InputError("query", None, None, words, "SQL that duckdb can answer") from None


def _print_rows(columns: list[str], rows: list[tuple[object, ...]], as_json: bool) -> None:
    """CSV as it is into a file or a pipe; on a terminal nothing that would move its cursor. Raises InputError."""
    import csv
    import json
    import sys

    from abhv_mc.io.input_error import InputError, printable

    if as_json:
        twice = sorted({name for name in columns if columns.count(name) > 1})
        if twice:
            found = f"several columns named {', '.join(twice)}"
            raise InputError("query", None, None, found, "names of their own: select ... as ..., or --csv")
        say(json.dumps([dict(zip(columns, row, strict=True)) for row in rows], indent=2, default=str))
    else:
        if sys.stdout.isatty():
            rows = [tuple(printable(cell) if isinstance(cell, str) else cell for cell in row) for row in rows]
        csv.writer(sys.stdout, lineterminator="\n").writerows([columns, *rows])
