"""The arguments and options that commands share: one grammar for all of them.

A campaign, mission, vehicle or controller is a path or the name of a shipped one.
"""

from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.outputs import json_file, output_file
from abhv_mc.io.input_error import InputError, Refusal
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input, shipped_files


def _of_kinds(*kinds: str) -> dict[str, Any]:
    """How a file of these kinds is found, and what a shell offers: shipped names, without one its own files."""

    def complete(incomplete: str) -> list[str]:
        return [
            name for kind in kinds for name in shipped_files(kind) if name.startswith(incomplete)
        ]

    def find(name: str) -> Path:
        path = find_input(name, *kinds)
        if kinds in (("mission",), ("vehicle",)):
            from abhv_mc.campaign.file.kinds import require_kind

            require_kind(path, kinds[0])
        return path

    words = f"{', '.join(kinds[:-1])}{' or ' * (len(kinds) > 1)}{kinds[-1]}".capitalize()
    words = f"{words} file, or the name of a shipped one."
    return {"parser": find, "autocompletion": complete, "help": words}


def _complete_folder(incomplete: str) -> list[str]:
    """Campaigns' folders in `reports`."""
    flown = [path.parent.as_posix() for path in sorted(Path("reports").glob("*/manifest.json"))]
    return [name for name in flown if name.startswith(incomplete)]


def _complete_metric(incomplete: str) -> list[str]:
    """Names of the built-in metrics."""
    from abhv_mc.flight.metrics import BUILT_IN

    return [name for name in BUILT_IN if name.startswith(incomplete)]


def _complete_controllers(incomplete: str) -> list[str]:
    """Names of the shipped controllers, after those that stand already before a comma."""
    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in shipped_files("control") if name.startswith(last)]


def controllers_option(words: str, **options: Any) -> Any:
    """An option that names several controllers."""
    names = "--controllers", "--controller"
    return typer.Option(
        *names, metavar="A,B", help=words, autocompletion=_complete_controllers, **options
    )


def metric_option(words: str, **options: Any) -> Any:
    """An option that names a metric."""
    return typer.Option(metavar="METRIC", help=words, autocompletion=_complete_metric, **options)


def controller_option(words: str, metavar: str = "C", **options: Any) -> Any:
    """An option that names one controller."""
    return typer.Option("--controller", "--controllers", metavar=metavar, help=words, **options)


CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN", **_of_kinds("campaign"))]
MissionFile = Annotated[Path, typer.Argument(metavar="MISSION", **_of_kinds("mission"))]
MissionOrCampaign = Annotated[
    Path, typer.Argument(metavar="MISSION", **_of_kinds("mission", "campaign"))
]
FlownFile = Annotated[
    Path, typer.Argument(metavar="MISSION", **_of_kinds("mission", "campaign", "vehicle"))
]
_DEFAULT = f"{DEFAULT_VEHICLE}, or the campaign's"
Vehicle = Annotated[
    Path | None, typer.Option(metavar="V", show_default=_DEFAULT, **_of_kinds("vehicle"))
]
NewVehicle = Annotated[
    Path | None,
    typer.Option("--vehicle", metavar="V", show_default="the campaign's", **_of_kinds("vehicle")),
]
ControllerFiles = Annotated[
    str | None,
    controllers_option(
        "Controller files or shipped names.", show_default="tlc,lqr, or the campaign's"
    ),
]
Controller = Annotated[
    str | None, controller_option("Controller.", "NAME", show_default="the first")
]


def folder_argument(words: str = "A campaign's folder.", metavar: str = "DIR") -> Any:
    """An argument that names the folder of a campaign."""
    return typer.Argument(metavar=metavar, help=words, autocompletion=_complete_folder)


Folder = Annotated[Path, folder_argument()]
Runs = Annotated[
    int | None,
    typer.Option(min=1, help="Flights of each controller.", show_default="the campaign's"),
]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Delete what the folder holds of a campaign first.")
]
Baseline = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Campaign flown before on the same samples; the report says what changed.",
        autocompletion=_complete_folder,
    ),
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Make no report.")]
TrustCode = Annotated[
    bool,
    typer.Option(
        "--trust-code", help="Run Python code of a campaign's folder that you have not flown."
    ),
]
Json = Annotated[
    Path | None,
    typer.Option(
        "--json",
        callback=json_file,
        metavar="FILE",
        help="Write the figures as JSON; - for standard output.",
    ),
]

Requirements = Annotated[
    Path | None,
    typer.Option(
        "--requirements",
        metavar="FILE",
        help="Judge by these: a campaign file, a file with 'requirements', or a CSV file.",
        show_default="the folder's",
    ),
]
Junit = Annotated[
    Path | None,
    typer.Option(
        "--junit", callback=output_file, metavar="FILE.xml", help="Write the verdicts as JUnit XML."
    ),
]


def parse_names(text: str | None, option: str = "--controllers") -> tuple[str, ...] | None:
    """Names with commas between them; None without the option. Raises InputError for an empty name."""
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        expected = "names with commas between them"
        raise InputError(option, f"'{text}', which holds an empty name", expected)
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
