"""The command ``import daveml``."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import say


def daveml(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE.dml...", help="DAVE-ML files of one vehicle.")
    ],
    out: Annotated[Path, output(output_folder, "DIR", "Folder for the vehicle.")],
) -> None:
    """Write DAVE-ML files (ANSI/AIAA S-119) as readable Python functions; their check shots must pass.

    What the files leave open is asked for in DIR/import.yaml.
    """
    from abhv_mc_daveml.import_vehicle import import_daveml

    for path in import_daveml(files, out):
        say(path)
