"""Arguments and options of the vehicle's commands, and messages about kernels."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli import printing
from abhv_mc.cli.options import controllers_option, of_kinds, parse_names
from abhv_mc.compiling import tell
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input

MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", **of_kinds("mission"))]
MissionOrCampaign = Annotated[
    Path, typer.Argument(metavar="MISSION", **of_kinds("mission", "campaign"))
]
FlownFile = Annotated[
    Path, typer.Argument(metavar="MISSION", **of_kinds("mission", "campaign", "vehicle"))
]
_DEFAULT = f"{DEFAULT_VEHICLE}, or the campaign's vehicle"
Vehicle = Annotated[
    Path | None, typer.Option(metavar="V", show_default=_DEFAULT, **of_kinds("vehicle"))
]
NewVehicle = Annotated[
    Path | None,
    typer.Option(
        "--vehicle", metavar="V", show_default="the campaign's vehicle", **of_kinds("vehicle")
    ),
]
ControllerFiles = Annotated[
    str | None,
    controllers_option(
        "Controllers to simulate: files, or names of shipped controllers.",
        show_default="tlc,lqr, or the campaign's controllers",
    ),
]


def find_controllers(text: str | None) -> dict[str, Path]:
    """Return controller files by name; by default, the files of tlc and lqr.

    Raise InputError if a file is missing or two files have the same name.
    """
    files = [find_input(name, "control") for name in parse_names(text) or ("tlc", "lqr")]
    if len({file.stem for file in files}) < len(files):
        raise InputError(
            "--controllers", f"files in '{text}' have the same name", "files with different names"
        )
    return {file.stem: file for file in files}


def announce_compiling() -> None:
    """Enable messages on standard error about kernels that are being compiled."""
    printing.announce_compiling()
    from abhv_mc_vehicle.kernel.jit import set_compile_listener

    set_compile_listener(tell)
