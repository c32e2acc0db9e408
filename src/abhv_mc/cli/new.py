"""``abhv-mc new``: a folder to start from."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.outputs import output_folder
from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, typer.Argument(callback=output_folder, metavar="DIR", help="A new or an empty folder.")],
    source: Annotated[
        str, typer.Option("--from", metavar="NAME", help="Name of a shipped campaign, such as wide or failures.")
    ] = "s_manoeuvre",
    law: Annotated[bool, typer.Option("--law", help="Add a commented control law of your own in Python.")] = False,
) -> None:
    """Write a commented campaign with its vehicle, mission and control files to start from."""
    from abhv_mc.campaign.file.new_campaign import write_new_campaign

    campaign, *others = write_new_campaign(folder, source, law)
    say(f"{campaign} and {len(others)} files that it needs. Next:")
    if law:
        say(f"  cd {folder} && abhv-mc fly level --controllers control/my_law.yaml   # after each edit of my_law.py")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")
