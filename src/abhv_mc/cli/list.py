"""``abhv-mc list``: what there is to choose from, and the campaigns that were flown."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.options import Json
from abhv_mc.cli.printing import new_table, print_table, say, show
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError, one_of

app = typer.Typer(help="List campaigns, parameters, channels, metrics or schemas.", no_args_is_help=True)
_DEFAULT = Path("reports")


@app.command()
def campaigns(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that holds campaigns' folders.")] = _DEFAULT,
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
            table.add_row(one.folder, held.state, flights, names, held.started, str(held.digest)[:12])
        print_table(table) if found else say(f"no campaigns in {folder}")

    show([one.as_entries() for one in found], json, in_words)


@app.command()
def parameters(json: Json = None) -> None:
    """List what a campaign may disperse. A unit of - is a factor or a number."""
    from dataclasses import asdict

    from abhv_mc.plant.parameters import PARAMETERS

    _show_records([asdict(parameter) for parameter in PARAMETERS[1:]], json)  # the first is no parameter of a vehicle


@app.command()
def channels(json: Json = None) -> None:
    """List what histories, envelopes and replays record."""
    from abhv_mc.flight.channels import CHANNELS

    _show_records([{"name": each.name, "unit": each.unit, "doc": each.doc} for each in CHANNELS], json)


@app.command()
def metrics(
    campaign: Annotated[
        str | None,
        typer.Argument(metavar="[CAMPAIGN]", help="Its file, or a shipped name: list what it declares, too."),
    ] = None,
    json: Json = None,
) -> None:
    """List what every flight is measured by: unit, what is bad, group, how it is counted, meaning.

    Stability margins stand at the end: a campaign that asks for them has them. What is counted is a source, or an
    expression of sources; with statistic, limit and window it is how a campaign would declare the same metric.
    """
    from abhv_mc.flight.metrics import BUILT_IN

    records = list(BUILT_IN.values())
    if campaign is not None:
        from abhv_mc.campaign.file.check import read_campaign
        from abhv_mc.shipped import find_input

        read = read_campaign(find_input(campaign, "campaign"))
        records = [*read.measured] if read.user_model else [*records, *read.declared]
    if json is not None:
        show([record.as_entry() for record in records], json, lambda: None)
        return
    columns = ("name", "unit", "bad", "group", "counted", "doc")
    _show_records([{key: getattr(record, key) for key in columns} for record in records], None)


@app.command()
def schemas(
    kind: Annotated[str | None, typer.Argument(metavar="[KIND]", help="Print the schema of this kind of file.")] = None,
    json: Json = None,
) -> None:
    """List the kinds of input file, the report and the manifest, or print the JSON Schema of one of them."""
    from functools import partial

    from abhv_mc.campaign.file.kinds import MODELS
    from abhv_mc.campaign.file.schema import make_schema
    from abhv_mc.folder.manifest import manifest_schema
    from abhv_mc.report.numbers.report_schema import report_schema

    known = {name: partial(make_schema, name) for name in MODELS} | {
        "report": report_schema,
        "manifest": manifest_schema,
    }
    if kind is None:
        _show_records([{"name": name, "doc": f"JSON Schema of a {name} file"} for name in known], json)
        return
    if kind not in known:
        raise InputError("list schemas", f"'{kind}'", one_of(known, kind))
    show(known[kind](), json or Path("-"), lambda: None)


def _show_records(records: list[dict[str, Any]], json: Path | None) -> None:
    def in_words() -> None:
        table = new_table((), (), show_header=False, padding=(0, 1, 0, 0))
        for key in records[0]:
            table.add_column(justify="right" if key in ("unit", "nominal") else "left", no_wrap=True)
        for record in records:
            table.add_row(*(f"{cell:g}" if isinstance(cell, float) else str(cell) for cell in record.values()))
        print_table(table)

    show(records, json, in_words)
