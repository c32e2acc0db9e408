"""``list``, ``query``, ``export``: what there is, and tables in other forms."""

import io
import sys
from contextlib import redirect_stdout
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from abhv_mc.cli.options import Folder, Json, controller_option, folder_argument
from abhv_mc.cli.outputs import output_file, output_file_or_stream, output_folder
from abhv_mc.cli.printing import answer, new_table, print_table, say
from abhv_mc.folder.layout import write_text
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError, one_of
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

if TYPE_CHECKING:
    from duckdb import DuckDBPyRelation

lists = typer.Typer(
    name="list",
    help="List campaigns, parameters, channels, metrics or schemas.",
    no_args_is_help=True,
)
_DEFAULT = Path("reports")


@lists.command()
def campaigns(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder that holds campaigns' folders.")
    ] = _DEFAULT,
    json: Json = None,
) -> None:
    """List the campaigns in a folder: state, flights, controllers, when, and the digest's first digits."""
    from abhv_mc.folder.remote import fetched_manifests
    from abhv_mc.folder.status import find_campaigns

    address = read_address(folder)
    if address is None and not folder.is_dir() and folder != _DEFAULT:
        raise InputError(folder, "no such folder", "one that holds campaigns' folders")
    with fetched_manifests(folder, "*/manifest.json") as (here, describe):
        found = find_campaigns(here, describe)
    if address is not None:
        found = [replace(one, folder=Path(one.folder).name) for one in found]

    def in_words() -> None:
        table = new_table(("folder", "state", "flights", "controllers", "started", "digest"), ())
        for one in found:
            held = one.manifest
            flights, names = f"{held.runs_done}/{held.runs_planned}", ",".join(held.controllers)
            table.add_row(
                one.folder, held.state, flights, names, held.started, str(held.digest)[:12]
            )
        print_table(table) if found else say(f"no campaigns in {folder}")

    answer([one.as_entries() for one in found], json, in_words)


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
    from dataclasses import asdict

    from abhv_mc.flight.vehicle_parameters import read_vehicle_parameters
    from abhv_mc.plant.parameters import OURS

    known = read_vehicle_parameters(find_input(vehicle, "vehicle"))[0] if vehicle else OURS
    _show_records([asdict(known[name]) for name in known.dispersible], json)


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
        str, typer.Argument(metavar="SQL", help="For example: select count(*) from flights")
    ],
    json: Json = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            "--csv",
            callback=output_file_or_stream,
            metavar="FILE",
            help="Write CSV; - for standard output.",
        ),
    ] = None,
) -> None:
    """Ask with SQL (duckdb); tables: flights, samples, histories, envelopes, nominal, reference.

    Parameters have a dot in their names: write them in double quotes, as in select "aero.lift" from samples.
    """
    from abhv_mc.folder.remote import fetched
    from abhv_mc.folder.tables import ask

    with fetched(folder) as source:
        if json is None and csv is None:
            say(ask(source, sql, _draw) or "", end="")
            return
        rows = ask(source, sql, lambda found: (found.columns, found.fetchall()))
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


def export(
    folder: Folder,
    mission: Annotated[
        str | None,
        typer.Argument(
            metavar="[MISSION]", help="After gains: mission file, or a shipped one's name."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="PATH",
            help="Where to: a folder; of gains, a .mat, .csv or .h file.",
        ),
    ] = None,
    controller: Annotated[str, controller_option("Of gains: file or shipped name.")] = "tlc",
    vehicle: Annotated[
        str, typer.Option(metavar="V", help="Of gains: file or shipped name.")
    ] = DEFAULT_VEHICLE,
) -> None:
    """Write every table as a CSV file; numbers read back to the same bits.

    ``export gains MISSION --controller lqr -o gains.mat`` writes a controller's gains over time instead.
    """
    if str(folder) == "gains" and mission is not None:
        from abhv_mc.one_flight.given import make_flight_plan
        from abhv_mc.simulators.export_gains import check_gain_format, write_gains

        if out is None:
            raise InputError("--output", "no file", "a file that ends in .mat, .csv or .h")
        check_gain_format(out)
        files = (
            find_input(mission, "mission"),
            find_input(vehicle, "vehicle"),
            find_input(controller, "control"),
        )
        write_gains(output_file(out) or out, make_flight_plan(*files))
        say(out)
        return
    from abhv_mc.folder.remote import fetched, local_path
    from abhv_mc.folder.tables import export_csv

    if mission is not None:
        raise InputError(
            mission, "a second argument", "nothing after the folder, or 'gains' before it"
        )
    out = output_folder(out)
    if out is None and local_path(folder) is None:
        raise InputError("--output", "nothing, for a campaign at an address", "-o DIR: where to")
    with fetched(folder) as source:
        for path in export_csv(source, out or folder / "csv"):
            say(path)
