"""Arguments and options shared by several commands.

A campaign, mission, vehicle or controller is given by a path, or by the name of a shipped file.
"""

from pathlib import Path
from typing import Annotated, Any

import typer

from abhv_mc.cli.outputs import json_file, output_file
from abhv_mc.io.input_error import InputError, Refusal
from abhv_mc.io.phrases import joined
from abhv_mc.shipped import find_input, shipped_files


def of_kinds(*kinds: str) -> dict[str, Any]:
    """Return parser, completion and help for an argument that accepts files of these kinds.

    Shells complete paths and the names of shipped files.
    """

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

    text = joined(kinds, "or").capitalize()
    text = f"{text} file, or the name of a shipped file."
    return {"parser": find, "autocompletion": complete, "help": text}


def _complete_folder(incomplete: str) -> list[str]:
    """Return the results folders in `reports` for shell completion."""
    folders = [path.parent.as_posix() for path in sorted(Path("reports").glob("*/manifest.json"))]
    return [name for name in folders if name.startswith(incomplete)]


def _complete_metric(incomplete: str) -> list[str]:
    """Return the names of built-in metrics for shell completion."""
    from abhv_mc.campaign.file.systems import load_simulators

    names = (name for own in load_simulators().values() for name in own.metrics)
    return [name for name in names if name.startswith(incomplete)]


def _complete_controllers(incomplete: str) -> list[str]:
    """Return completions for the last controller of a comma-separated list."""
    previous, comma, last = incomplete.rpartition(",")
    return [
        f"{previous}{comma}{name}" for name in shipped_files("control") if name.startswith(last)
    ]


def controllers_option(purpose: str, **options: Any) -> Any:
    """Return an option for the names of several controllers."""
    names = "--controllers", "--controller"
    return typer.Option(
        *names, metavar="A,B", help=purpose, autocompletion=_complete_controllers, **options
    )


def metric_option(purpose: str, **options: Any) -> Any:
    """Return an option for the name of a metric."""
    return typer.Option(metavar="METRIC", help=purpose, autocompletion=_complete_metric, **options)


def controller_option(purpose: str, metavar: str = "C", **options: Any) -> Any:
    """Return an option for the name of one controller."""
    return typer.Option("--controller", "--controllers", metavar=metavar, help=purpose, **options)


CampaignFile = Annotated[Path, typer.Argument(metavar="CAMPAIGN", **of_kinds("campaign"))]
Controller = Annotated[
    str | None,
    controller_option("Controller to use.", "NAME", show_default="the only controller under test"),
]


def folder_argument(purpose: str = "Results folder of a campaign.", metavar: str = "DIR") -> Any:
    """Return an argument for the results folder of a campaign."""
    return typer.Argument(metavar=metavar, help=purpose, autocompletion=_complete_folder)


Folder = Annotated[Path, folder_argument()]
Runs = Annotated[
    int | None,
    typer.Option(
        min=1, help="Number of flights per controller.", show_default="the campaign's number"
    ),
]
Fresh = Annotated[
    bool, typer.Option("--fresh", help="Delete an existing campaign in the folder and start again.")
]
Baseline = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="Results folder of an earlier campaign with the same samples; the report lists the "
        "changes.",
        autocompletion=_complete_folder,
    ),
]
NoReport = Annotated[bool, typer.Option("--no-report", help="Do not create a report.")]
TrustCode = Annotated[
    bool,
    typer.Option(
        "--trust-code",
        help=(
            "Allow the campaign's custom code to run even if it has not been run on this machine "
            "before."
        ),
    ),
]
Json = Annotated[
    Path | None,
    typer.Option(
        "--json",
        callback=json_file,
        metavar="FILE",
        help="Write the results as JSON to FILE, or to standard output if FILE is -.",
    ),
]

Requirements = Annotated[
    Path | None,
    typer.Option(
        "--requirements",
        metavar="FILE",
        help=(
            "Requirements for the assessment: a campaign file, a file with 'requirements', or a "
            "CSV file."
        ),
        show_default="the campaign's requirements",
    ),
]
Junit = Annotated[
    Path | None,
    typer.Option(
        "--junit",
        callback=output_file,
        metavar="FILE.xml",
        help="Write the verdicts as JUnit XML, for continuous integration.",
    ),
]


def parse_names(text: str | None, option: str = "--controllers") -> tuple[str, ...] | None:
    """Return the names in a comma-separated option, or None if the option is absent.

    Raise InputError if a name is empty.
    """
    if text is None:
        return None
    names = tuple(name.strip() for name in text.split(","))
    if not all(names):
        raise InputError(option, f"'{text}' has an empty name", "names separated by commas")
    return names


def parse_option(option: str, text: str, dimension: Any, bare_unit: str | None = None) -> float:
    """Return an option's value in SI units; ``bare_unit`` is the unit of plain numbers.

    Raise InputError if the value is invalid.
    """
    from abhv_mc.io.units import parse_quantity

    try:
        return parse_quantity(text.strip(), dimension, bare_unit)
    except Refusal as refusal:
        raise InputError(option, refusal.found, refusal.expected) from None
