"""What the searching commands share."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.cli.outputs import campaign_folder, new_file
from abhv_mc.io.input_error import InputError

CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN.yaml", help="Campaign file.")]
Folder = Annotated[
    Path,
    typer.Option(
        "--output", "-o", callback=campaign_folder, metavar="DIR", help="Folder for the flights and the page."
    ),
]
Controller = Annotated[str | None, typer.Option(help="Controller.", show_default="the first")]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed.", show_default="the campaign's")]
Workers = Annotated[
    int | None, typer.Option(min=1, max=MOST_WORKERS, help="Flights in parallel.", show_default="cores")
]
Scheduler = Annotated[str | None, typer.Option(metavar="ADDRESS", help="Fly on this Dask cluster.")]
JsonFile = Annotated[Path | None, typer.Option("--json", callback=new_file, metavar="FILE", help="Write the result.")]
Shard = Annotated[str | None, typer.Option(hidden=True)]
Fresh = Annotated[bool, typer.Option("--fresh", help="Delete what the folder holds first.")]


def refuse_shard(shard: str | None) -> None:
    """A search has no parts. Raises InputError."""
    if shard is not None:
        wanted = (
            "no shards: each batch of a search depends on the one before; --workers or --scheduler share its flights"
        )
        raise InputError("--shard", None, None, shard, wanted)


def write_json(path: Path | None, numbers: dict[str, Any]) -> None:
    """Write the result where it is asked for; infinite and missing numbers are null."""
    if path is not None:
        from abhv_mc.folder.layout import write_text
        from abhv_mc.report.numbers.plain import plain

        write_text(path, json.dumps(plain(numbers), indent=2, allow_nan=False) + "\n")
