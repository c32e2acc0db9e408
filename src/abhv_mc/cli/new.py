"""``abhv-mc new``: a folder to start from."""

from pathlib import Path
from typing import Annotated

import typer


def command(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A new or an empty folder.")]) -> None:
    """Write a commented campaign with its vehicle, mission and control files to start from."""
    from abhv_mc.campaign.file.new_campaign import write_new_campaign

    campaign, *others = write_new_campaign(folder)
    print(f"{campaign} and {len(others)} files that it needs. Next:")
    print(f"  cd {folder} && abhv-mc run {campaign.name}")
