"""The command ``import jsbsim``."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.outputs import output, output_folder
from abhv_mc.cli.printing import announce_warnings, say


def jsbsim(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.xml", help="A JSBSim model of an aircraft.")
    ],
    out: Annotated[Path, output(output_folder, "DIR", "Folder for the vehicle.")],
) -> None:
    """Write a JSBSim model's aerodynamics, metrics and mass as a vehicle; what else it has is named."""
    from abhv_mc_jsbsim.import_vehicle import import_jsbsim

    imported = import_jsbsim(model, out)
    for path in imported.paths:
        say(path)
    for name in imported.settings:
        say(f"a number in the vehicle file: {name}")
    for name in imported.left_out:
        say(f"left out: {name}")
    announce_warnings(f"{path} was edited; the new text is beside it" for path in imported.kept)
