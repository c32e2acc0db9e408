"""The arguments and options that commands share: one grammar for all of them.

A campaign, mission, vehicle or controller is a path or the name of a shipped one.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.campaign import MOST_WORKERS
from abhv_mc.cli.outputs import json_file, output_file
from abhv_mc.cli.shell_completion import complete_controllers, complete_folder, complete_input
from abhv_mc.io.input_error import InputError, Refusal
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input


def _find(*kinds: str) -> Callable[[str], Path]:
    return lambda name: find_input(name, *kinds)


def _input(metavar: str, *kinds: str) -> Any:
    """An argument that names a file of these kinds."""
    words = f"{' or '.join(kinds).capitalize()} file, or the name of a shipped one."
    return typer.Argument(parser=_find(*kinds), metavar=metavar, help=words, autocompletion=complete_input(*kinds))


CampaignFile = Annotated[Path, _input("CAMPAIGN", "campaign")]
MissionFile = Annotated[Path, _input("MISSION", "mission")]
MissionOrCampaign = Annotated[Path, _input("MISSION", "mission", "campaign")]
VehicleFile = Annotated[Path, _input("VEHICLE", "vehicle")]
Vehicle = Annotated[
    Path | None,
    typer.Option(
        parser=_find("vehicle"),
        metavar="V",
        help="Vehicle file, or the name of a shipped one.",
        autocompletion=complete_input("vehicle"),
        show_default=f"{DEFAULT_VEHICLE}, or the campaign's",
    ),
]
ControllerFiles = Annotated[
    str | None,
    typer.Option(
        "--controllers",
        "--controller",
        metavar="A,B",
        help="Controller files or shipped names.",
        autocompletion=complete_controllers,
        show_default="tlc,lqr, or the campaign's",
    ),
]
Controllers = Annotated[
    str | None,
    typer.Option(
        "--controllers",
        "--controller",
        metavar="A,B",
        help="Only these of its controllers.",
        autocompletion=complete_controllers,
    ),
]
Controller = Annotated[
    str | None,
    typer.Option("--controller", "--controllers", metavar="NAME", help="Controller.", show_default="the first"),
]


def folder_argument(words: str = "A campaign's folder.", metavar: str = "DIR") -> Any:
    """An argument that names the folder of a campaign."""
    return typer.Argument(metavar=metavar, help=words, autocompletion=complete_folder)


Folder = Annotated[Path, folder_argument()]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed.", show_default="the campaign's")]
Runs = Annotated[int | None, typer.Option(min=1, help="Flights of each controller.", show_default="the campaign's")]
Workers = Annotated[
    int | None, typer.Option(min=1, max=MOST_WORKERS, help="Flights in parallel.", show_default="cores")
]
Scheduler = Annotated[str | None, typer.Option(metavar="ADDRESS", help="Fly on this Dask cluster.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Delete what the folder holds of a campaign first.")]
Baseline = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Campaign flown before on the same samples; the report says what changed.",
        autocompletion=complete_folder,
    ),
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Make no report.")]
TrustCode = Annotated[
    bool, typer.Option("--trust-code", help="Run Python code of a campaign's folder that you have not flown.")
]
Json = Annotated[
    Path | None,
    typer.Option(
        "--json", callback=json_file, metavar="FILE", help="Write the figures as JSON; - for standard output."
    ),
]

Junit = Annotated[
    Path | None,
    typer.Option("--junit", callback=output_file, metavar="FILE.xml", help="Write the verdicts as JUnit XML."),
]


def parse_names(text: str | None) -> tuple[str, ...] | None:
    """Names with commas between them; None without the option. Raises InputError for an empty name."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError("--controllers", f"'{text}', which holds an empty name", "names such as tlc,lqr")
    return names


def find_controllers(text: str | None) -> dict[str, Path]:
    """Controller files by their names; tlc and lqr without the option. Raises InputError."""
    files = [find_input(name, "control") for name in parse_names(text) or ("tlc", "lqr")]
    if len({file.stem for file in files}) < len(files):
        raise InputError("--controllers", str(text), "files of different names")
    return {file.stem: file for file in files}


def parse_option(option: str, text: str, dimension: Any, bare_unit: str | None = None) -> float:
    """A quantity of an option in SI; without a unit it is in ``bare_unit``. Raises InputError."""
    from abhv_mc.io.units import parse_quantity

    try:
        return parse_quantity(text.strip(), dimension, bare_unit)
    except Refusal as refusal:
        raise InputError(option, refusal.found, refusal.expected) from None
