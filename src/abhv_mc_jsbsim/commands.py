"""Command ``import jsbsim``."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import output, output_folder
from abhv_mc.cli.printing import announce_warnings, say


def jsbsim(
    model: Annotated[
        Path, typer.Argument(metavar="MODEL.xml", help="JSBSim model of an aircraft.")
    ],
    out: Annotated[Path, output(output_folder, "DIR", "Folder for the vehicle files.")],
) -> None:
    """Import the aerodynamics, reference dimensions and mass of a JSBSim model as a vehicle.

    The command lists the parts of the model that are not imported.
    """
    from abhv_mc_jsbsim.import_vehicle import import_jsbsim

    imported = import_jsbsim(model, out)
    for path in imported.paths:
        say(path)
    for name in imported.settings:
        say(f"constant in the vehicle file: {name}")
    for name in imported.left_out:
        say(f"not imported: {name}")
    announce_warnings(
        f"{path} was edited and is kept; the new version is written next to it"
        for path in imported.kept
    )
