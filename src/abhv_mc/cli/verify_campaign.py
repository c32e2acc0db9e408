"""``abhv-mc verify campaign``: hold a report against its data."""

from pathlib import Path
from typing import Annotated

import typer


def command(folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a campaign.")]) -> None:
    """Make every number of a campaign's report again from its Parquet; exit 1 at the first that differs."""
    from abhv_mc.report.verify import verify_campaign

    for difference in verify_campaign(folder):
        print(difference)
        raise typer.Exit(1)
    print(f"{folder}: every number of the report follows from the data")
