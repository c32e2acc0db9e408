"""Commands ``list`` and ``query`` for shipped files, definitions and tables."""

import io
import re
import sys
from contextlib import redirect_stdout
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import Json, folder_argument, output_file_or_stream, output_folder
from abhv_mc.cli.printing import new_table, print_table, say, show_result
from abhv_mc.folder.layout import write_text
from abhv_mc.io.messages import InputError, check_names, quoted

if TYPE_CHECKING:
    from duckdb import DuckDBPyRelation

lists = typer.Typer(
    name="list",
    help="List shipped campaigns, vehicles, missions and controllers, or parameters, channels, "
    "metrics and schemas.",
    no_args_is_help=True,
)


@lists.command()
def campaigns(json: Json = None) -> None:
    """List the shipped campaigns and their questions; `runs` lists campaigns with results."""
    list_shipped("campaign", json)


def list_shipped(kind: str, json: Path | None) -> None:
    """List shipped files, each with its question, description or first comment."""
    from abhv_mc.io.documents import read_document
    from abhv_mc.shipped import shipped_files

    records = []
    for name, path in shipped_files(kind).items():
        data: Any = read_document(path).data
        comment = takewhile(lambda line: line.startswith("#"), path.read_text("utf-8").splitlines())
        first = " ".join(line.removeprefix("#").strip() for line in comment)
        sentence = re.split(r"(?<=[.?]) (?=[A-Z])", first)[0]
        records.append(
            {"name": name, "doc": data.get("question") or data.get("description") or sentence}
        )
    show_records(records, json)


@lists.command()
def schemas(
    kind: Annotated[
        str | None,
        typer.Argument(metavar="[KIND]", help="Kind of file whose JSON Schema is printed."),
    ] = None,
    json: Json = None,
) -> None:
    """List the kinds of files that have a JSON Schema, or print the schema of one kind."""
    from abhv_mc.campaign.file.kinds import find_kinds
    from abhv_mc.campaign.file.schema import make_schema
    from abhv_mc.folder.manifest import manifest_schema
    from abhv_mc.report.numbers.report_numbers import report_schema

    results = {"report": report_schema, "manifest": manifest_schema}
    names = (*find_kinds(), *results)
    if kind is None:
        show_records(
            [{"name": name, "doc": f"JSON Schema of a {name} file"} for name in names], json
        )
        return
    check_names("list schemas", [kind], names, "kind")
    show_result(
        results[kind]() if kind in results else make_schema(kind),
        json or Path("-"),
        lambda: None,
    )


def show_records(records: list[dict[str, Any]], json: Path | None) -> None:
    """Print records as a table, or as JSON."""

    def print_text() -> None:
        table = new_table((), (), show_header=False, padding=(0, 1, 0, 0))
        for key in records[0]:
            table.add_column(
                justify="right" if key in ("unit", "nominal") else "left", no_wrap=True
            )
        for record in records:
            table.add_row(
                *(f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in record.values())
            )
        print_table(table)

    show_result(records, json, print_text)


def query(
    folder: Annotated[Path, folder_argument("Results folder of a campaign (path or address).")],
    sql: Annotated[
        str | None,
        typer.Argument(
            metavar="[SQL]", help="SQL statement, for example: select count(*) from flights"
        ),
    ] = None,
    json: Json = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            metavar="PATH",
            help="Write the result as CSV to the file PATH, or to standard output if PATH is -. "
            "Without SQL, write all tables to the folder PATH.",
        ),
    ] = None,
) -> None:
    """Query the tables of a campaign with SQL (duckdb), or export them as CSV.

    The tables are flights, samples, histories, envelopes, nominal and reference. Parameter names
    contain a dot and must be enclosed in double quotes, as in: select "aero.lift" from samples.
    Numbers are written to CSV files with full precision.
    """
    from abhv_mc.folder.stores import open_store
    from abhv_mc.folder.tables import export_csv, run_query

    if sql is None:
        if csv is None or csv == Path("-") or json is not None:
            raise InputError(
                "query",
                "no SQL statement is given",
                "an SQL statement, or --csv DIR to export all tables",
            )
        tables = output_folder(csv) or csv
        with open_store(folder).reading() as source:
            for path in export_csv(source, tables):
                say(path)
        return
    csv = output_file_or_stream(csv)
    with open_store(folder).reading() as source:
        if json is None and csv is None:
            say(run_query(source, sql, _draw) or "", end="")
            return
        rows = run_query(source, sql, lambda relation: (relation.columns, relation.fetchall()))
    if rows is not None:
        if csv is not None:
            _write_csv(*rows, csv)
        if json is not None:
            show_result(_as_records(*rows), json, lambda: None)


def _draw(relation: "DuckDBPyRelation") -> str:
    """Return the result of a query as a text table."""
    stream = io.StringIO()
    with redirect_stdout(stream):
        relation.show(max_rows=200, max_width=200)
    return stream.getvalue()


def _write_csv(columns: list[str], rows: list[tuple[object, ...]], file: Path) -> None:
    """Write CSV to a file or standard output; for a terminal, control characters are escaped."""
    from abhv_mc.io.csv_table import csv_text

    text = csv_text([columns, *rows])
    if file != Path("-"):
        write_text(file, text)
    elif sys.stdout.isatty():
        say(text, end="")
    else:
        sys.stdout.write(text)


def _as_records(columns: list[str], rows: list[tuple[object, ...]]) -> list[dict[str, object]]:
    """Return each row as a dictionary. Raise InputError if two columns share a name."""
    repeated = sorted({name for name in columns if columns.count(name) > 1})
    if repeated:
        problem = f"several columns have the same name: {quoted(repeated)}"
        raise InputError("query", problem, "distinct names (select ... as ...), or --csv")
    return [dict(zip(columns, row, strict=True)) for row in rows]
