"""``abhv-mc query``: SQL over a campaign's tables."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from abhv_mc.cli.options import Json, folder_argument
from abhv_mc.cli.outputs import output_file_or_stream
from abhv_mc.cli.printing import say, show
from abhv_mc.io.input_error import InputError

if TYPE_CHECKING:
    from duckdb import DuckDBPyRelation


def command(
    folder: Annotated[Path, folder_argument("A campaign's folder, or its address.")],
    sql: Annotated[str, typer.Argument(metavar="SQL", help="For example: select count(*) from flights")],
    json: Json = None,
    csv: Annotated[
        Path | None,
        typer.Option("--csv", callback=output_file_or_stream, metavar="FILE", help="Write CSV; - for standard output."),
    ] = None,
) -> None:
    """Ask with SQL (duckdb); tables: flights, samples, histories, envelopes, nominal, reference.

    Parameters have a dot in their names: write them in double quotes, as in select "aero.lift" from samples.
    """
    from abhv_mc.folder.remote import fetched
    from abhv_mc.folder.sql import ask

    with fetched(folder) as source:
        if json is None and csv is None:
            say(ask(source, sql, _draw) or "", end="")
            return
        rows = ask(source, sql, lambda answer: (answer.columns, answer.fetchall()))
    if rows is not None:
        if csv is not None:
            _write_csv(*rows, csv)
        if json is not None:
            show(_as_records(*rows), json, lambda: None)


def _draw(answer: "DuckDBPyRelation") -> str:
    """The answer as a table of characters."""
    import contextlib
    import io

    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        answer.show(max_rows=200, max_width=200)
    return shown.getvalue()


def _write_csv(columns: list[str], rows: list[tuple[object, ...]], file: Path) -> None:
    """CSV as it is into a file or a pipe; on a terminal nothing that would move its cursor."""
    import csv
    import io

    from abhv_mc.folder.layout import write_text

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([columns, *rows])
    if file != Path("-"):
        write_text(file, text.getvalue())
    elif sys.stdout.isatty():
        say(text.getvalue(), end="")
    else:
        sys.stdout.write(text.getvalue())


def _as_records(columns: list[str], rows: list[tuple[object, ...]]) -> list[dict[str, object]]:
    """A mapping for each row. Raises InputError where columns share a name."""
    twice = sorted({name for name in columns if columns.count(name) > 1})
    if twice:
        found = f"several columns named {', '.join(twice)}"
        raise InputError("query", found, "names of their own: select ... as ..., or --csv")
    return [dict(zip(columns, row, strict=True)) for row in rows]
