"""``list``, ``query``: what ships, and a campaign's tables in other forms."""

import io
import re
import sys
from contextlib import redirect_stdout
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import Json, folder_argument
from abhv_mc.cli.outputs import output_file_or_stream, output_folder
from abhv_mc.cli.printing import answer, new_table, print_table, say
from abhv_mc.folder.layout import write_text
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    from duckdb import DuckDBPyRelation

lists = typer.Typer(
    name="list",
    help="List what ships: campaigns, vehicles, missions, controllers, parameters, channels, metrics, schemas.",
    no_args_is_help=True,
)


@lists.command()
def campaigns(json: Json = None) -> None:
    """List the shipped campaigns with their questions; `runs` lists those that were run."""
    _list_shipped("campaign", json)


@lists.command()
def vehicles(json: Json = None) -> None:
    """List the shipped vehicles."""
    _list_shipped("vehicle", json)


@lists.command()
def missions(json: Json = None) -> None:
    """List the shipped missions."""
    _list_shipped("mission", json)


@lists.command()
def controllers(json: Json = None) -> None:
    """List the shipped controllers."""
    _list_shipped("control", json)


def _list_shipped(kind: str, json: Path | None) -> None:
    """List shipped files with their question or description, or the first sentence of the comment above them."""
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
    _show_records(records, json)


@lists.command()
def parameters(
    vehicle: Annotated[
        str | None,
        typer.Argument(
            metavar="VEHICLE",
            help="Shipped name or file: its functions' settings and custom states, too.",
            show_default=False,
        ),
    ] = None,
    json: Json = None,
) -> None:
    """List what a campaign may disperse. A unit of - is a factor or a number."""
    from abhv_mc.flight.vehicle_parameters import read_vehicle_parameters
    from abhv_mc.plant.parameters import OURS

    known = read_vehicle_parameters(find_input(vehicle, "vehicle"))[0] if vehicle else OURS
    keys = ("name", "unit", "nominal", "doc")
    records = [known[name] for name in known.dispersible]
    _show_records([{key: getattr(record, key) for key in keys} for record in records], json)


@lists.command()
def channels(json: Json = None) -> None:
    """List what histories, envelopes and replays record."""
    from abhv_mc.flight.channels import CHANNELS

    _show_records(
        [{"name": each.name, "unit": each.unit, "doc": each.doc} for each in CHANNELS], json
    )


@lists.command()
def metrics(
    campaign: Annotated[
        str | None,
        typer.Argument(
            metavar="[CAMPAIGN]", help="Its file, or a shipped name: list what it declares, too."
        ),
    ] = None,
    json: Json = None,
) -> None:
    """List what every flight is measured by: unit, what is bad, group, how it is counted, meaning.

    Stability margins stand at the end: a campaign that asks for them has them. What is counted is a source, or an
    expression of sources; with statistic, limit and window it is how a campaign would declare the same metric.
    """
    from abhv_mc.flight.metrics import BUILT_IN, MARGINS

    records = list(BUILT_IN.values())
    if campaign is not None:
        from abhv_mc.campaign.file.check import read_campaign

        read = read_campaign(find_input(campaign, "campaign"))
        margins = MARGINS if read.simulator.capabilities.has_margins else ()
        records = [*read.measured, *margins]
    if json is not None:
        answer([record.as_entry() for record in records], json, lambda: None)
        return
    columns = ("name", "unit", "bad", "group", "counted", "doc")
    _show_records([{key: getattr(record, key) for key in columns} for record in records], None)


@lists.command()
def schemas(
    kind: Annotated[
        str | None, typer.Argument(metavar="[KIND]", help="Print the schema of this kind of file.")
    ] = None,
    json: Json = None,
) -> None:
    """List the kinds of input file, the report and the manifest, or print the JSON Schema of one of them."""
    from functools import partial

    from abhv_mc.campaign.file.kinds import MODELS
    from abhv_mc.campaign.file.schema import make_schema
    from abhv_mc.folder.manifest import manifest_schema
    from abhv_mc.report.numbers.report_numbers import report_schema

    known = {name: partial(make_schema, name) for name in MODELS} | {
        "report": report_schema,
        "manifest": manifest_schema,
    }
    if kind is None:
        _show_records(
            [{"name": name, "doc": f"JSON Schema of a {name} file"} for name in known], json
        )
        return
    if kind not in known:
        raise InputError("list schemas", f"'{kind}'", one_of(known, kind))
    answer(known[kind](), json or Path("-"), lambda: None)


def _show_records(records: list[dict[str, Any]], json: Path | None) -> None:
    def in_words() -> None:
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

    answer(records, json, in_words)


def query(
    folder: Annotated[Path, folder_argument("A campaign's folder, or its address.")],
    sql: Annotated[
        str | None,
        typer.Argument(metavar="[SQL]", help="For example: select count(*) from flights"),
    ] = None,
    json: Json = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            metavar="PATH",
            help="Write CSV: a file, or - for standard output; without SQL a folder.",
        ),
    ] = None,
) -> None:
    """Ask with SQL (duckdb); tables: flights, samples, histories, envelopes, nominal, reference.

    Without SQL, --csv writes every table as a CSV file into a folder; numbers read back to the same bits.
    Parameters have a dot in their names: write them in double quotes, as in select "aero.lift" from samples.
    """
    from abhv_mc.folder.stores import open_store
    from abhv_mc.folder.tables import export_csv, run_query

    if sql is None:
        if csv is None or csv == Path("-") or json is not None:
            raise InputError("query", "no SQL", "SQL, or --csv DIR for every table as CSV")
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
        rows = run_query(source, sql, lambda found: (found.columns, found.fetchall()))
    if rows is not None:
        if csv is not None:
            _write_csv(*rows, csv)
        if json is not None:
            answer(_as_records(*rows), json, lambda: None)


def _draw(found: "DuckDBPyRelation") -> str:
    """The answer as a table of characters."""
    shown = io.StringIO()
    with redirect_stdout(shown):
        found.show(max_rows=200, max_width=200)
    return shown.getvalue()


def _write_csv(columns: list[str], rows: list[tuple[object, ...]], file: Path) -> None:
    """CSV as it is into a file or a pipe; on a terminal nothing that would move its cursor."""
    from abhv_mc.io.csv_table import csv_text

    text = csv_text([columns, *rows])
    if file != Path("-"):
        write_text(file, text)
    elif sys.stdout.isatty():
        say(text, end="")
    else:
        sys.stdout.write(text)


def _as_records(columns: list[str], rows: list[tuple[object, ...]]) -> list[dict[str, object]]:
    """A mapping for each row. Raises InputError where columns share a name."""
    twice = sorted({name for name in columns if columns.count(name) > 1})
    if twice:
        found = f"several columns named {', '.join(twice)}"
        raise InputError("query", found, "names of their own: select ... as ..., or --csv")
    return [dict(zip(columns, row, strict=True)) for row in rows]
