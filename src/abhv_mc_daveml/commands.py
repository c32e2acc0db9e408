"""Command ``import daveml``."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import output, output_folder
from abhv_mc.cli.printing import announce_warnings, say
from abhv_mc.io.messages import counted


def daveml(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE.dml...", help="DAVE-ML files of one vehicle.")
    ],
    out: Annotated[Path, output(output_folder, "DIR", "Folder for the vehicle.")],
) -> None:
    """Import DAVE-ML files (ANSI/AIAA S-119) as readable Python functions.

    The check shots of the files must pass. If inputs are missing, they are listed in
    DIR/import.yaml; enter their values there and run the same command again.
    """
    from abhv_mc_daveml.import_vehicle import import_daveml

    imported = import_daveml(files, out)
    for name, shots in imported.shots.items():
        say(
            f"{name}: {counted(shots, 'check shot passes/check shots pass')}"
            if shots
            else f"{name}: the file contains no check shots"
        )
    for path in imported.paths:
        say(path)
    announce_warnings(
        f"{path} was edited and is kept; the new version is written next to it"
        for path in imported.kept
    )
