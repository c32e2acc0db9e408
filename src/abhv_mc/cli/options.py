"""Arguments and options of several commands, checks of output paths, and options of requests.

A campaign, mission, vehicle or controller is given by a path, or by the name of a shipped file.
"""

import inspect
import os
from collections.abc import Callable
from math import inf
from pathlib import Path
from typing import Annotated, Any, get_args

import typer

from abhv_mc.io.address import read_address
from abhv_mc.io.messages import InputError, Refusal, joined
from abhv_mc.requests import Option, options_of, parse_pairs
from abhv_mc.shipped import find_input, shipped_files

_INPUTS = (".yaml", ".yml", ".py", ".csv", ".parquet")


def output(
    check: Callable[[Path | None], Path | None],
    metavar: str,
    purpose: str,
    default: str | bool = True,
) -> Any:
    """Return the option ``--output``; ``default`` describes the default path."""
    return typer.Option(
        "--output", "-o", callback=check, metavar=metavar, help=purpose, show_default=default
    )


def output_file(path: Path | None) -> Path | None:
    """Return the path of an output file. Raise InputError if the file cannot be written."""
    if path is None:
        return None
    # If root wrote to /dev/null, the file would replace the device.
    if path.exists() and not path.is_file():
        raise InputError(path, "the path is a folder or a device", "the name of a file")
    return _check(path, path.absolute().parent)


def output_file_or_stream(path: Path | None) -> Path | None:
    """Return the path of an output file, or ``-`` for standard output.

    Raise InputError if the file cannot be written.
    """
    return path if path == Path("-") else output_file(path)


def json_file(path: Path | None) -> Path | None:
    """Return the path of a JSON output file, or ``-`` for standard output.

    Raise InputError if the file cannot be written, or if an existing input file would be
    overwritten.
    """
    if path is not None and path.suffix in _INPUTS and path.exists():
        raise InputError(
            path, f"an existing {path.suffix} file would be replaced", "the name of a JSON file"
        )
    return output_file_or_stream(path)


def output_folder(path: Path | None) -> Path | None:
    """Return the path of an output folder.

    Raise InputError if the path belongs to the results folder of a campaign.
    """
    return None if path is None else _check_folder(path)


def campaign_folder(path: Path | None) -> Path | None:
    """Return the path of a new or existing results folder.

    Raise InputError if the path cannot be used as a results folder.
    """
    return None if path is None else _check_folder(path, campaign=True)


def campaign_folder_or_address(path: Path | None) -> Path | None:
    """Return the path of a results folder, or an address such as s3://bucket/folder."""
    return path if path is not None and _is_address(path) else campaign_folder(path)


def _check_folder(path: Path, campaign: bool = False) -> Path:
    if path.is_file():
        raise InputError(path, "the path is a file", "the name of a folder")
    return _check(path, path.absolute(), campaign)


def _check(path: Path, folder: Path, campaign: bool = False) -> Path:
    from abhv_mc.folder.layout import find_in_campaign

    if _is_address(path):
        raise InputError(path, "the path is an address", "a path on this machine")
    location = find_in_campaign(path)
    if location is not None and not (campaign and location == Path()):
        raise InputError(
            path, "the path is inside the folder of a campaign", "a path outside campaign folders"
        )
    existing = next(parent for parent in (folder, *folder.parents) if parent.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK):
        raise InputError(path, f"{existing} cannot be written", "a path in a writable folder")
    return path


def _is_address(path: Path) -> bool:
    return read_address(f"{path}/") is not None  # Path("s3://") drops the slashes.


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

    return [
        name
        for own in load_simulators().values()
        for name in own.metrics
        if name.startswith(incomplete)
    ]


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
        help="Allow the campaign's custom code to run even if it has not been run on this machine "
        "before.",
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

FLIGHTS = (
    "test flights: time histories with the column time (s) and columns of channels, or tables with "
    "a row for each flight: metrics, or the file of its history (history), its vehicle, and "
    "measured parameters."
)
Measured = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=SIGMA",
        help="Standard deviation of the measurement error of a channel or metric of test flights, "
        "in its unit; repeatable.",
    ),
]
Requirements = Annotated[
    Path | None,
    typer.Option(
        "--requirements",
        metavar="FILE",
        help="Requirements for the assessment: a campaign file, a file with 'requirements', or a "
        "CSV file.",
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


def parse_noise(settings: list[str] | None) -> dict[str, float]:
    """Parse the noise of each channel. Raise InputError unless all values are positive."""

    def parse(text: str) -> float:
        if not 0.0 < (number := float(text)) < inf:
            raise ValueError(text)
        return number

    return parse_pairs("--measured", settings or (), "NAME=SIGMA with a positive number", parse)


def parse_option(option: str, text: str, dimension: Any, bare_unit: str | None = None) -> float:
    """Return an option's value in SI units; ``bare_unit`` is the unit of plain numbers.

    Raise InputError if the value is invalid.
    """
    from abhv_mc.io.units import parse_quantity

    try:
        return parse_quantity(text.strip(), dimension, bare_unit)
    except Refusal as refusal:
        raise InputError(option, refusal.found, refusal.expected) from None


def _parse_shard(text: str) -> tuple[int, int]:
    i, slash, n = text.partition("/")
    if not (text.isascii() and slash and i.isdecimal() and n.isdecimal()):
        raise InputError(
            "--shard", f"invalid shard '{text}'", "a shard and the number of shards, such as 3/8"
        )
    return int(i), int(n)


# Type and typer declaration of each kind of option; options of all other kinds are flags.
_KINDS = {
    "address": (Path, lambda o: output(campaign_folder_or_address, "DIR", o.help, o.default or "")),
    "campaign": (Path, lambda _: get_args(CampaignFile)[1]),
    "controller": (str, lambda o: controller_option(o.help, "NAME", show_default=o.default)),
    "controllers": (str, lambda o: controllers_option(o.help)),
    "count": (int, lambda o: _option(o, min=o.low, max=o.high)),
    "file": (Path, lambda o: _option(o, "--tune", metavar="FILE")),
    "folder": (Path | None, lambda o: output(campaign_folder, "DIR", o.help, o.default or "")),
    "metric": (str, lambda o: metric_option(o.help)),
    "new file": (Path, lambda o: output(output_file, "NEW.yaml", o.help)),
    "requirement": (str, lambda o: _option(o, metavar="ID")),
    "number": (float, lambda o: _option(o, min=o.low, max=o.high)),
    "results": (Path, lambda o: _option(o, metavar="DIR")),
    "scheduler": (str, lambda o: _option(o, metavar="ADDRESS")),
    "shard": (str, lambda o: _option(o, metavar="I/N")),
    "share": (str, lambda o: _option(o, metavar="COV")),
    "side": (bool, lambda o: _option(o, "--above/--below")),
}
_EXPERT = {"plans", "target_cov"}  # fields that only the pages of the commands list
_PARSERS: dict[str, Callable[[Any], Any]] = {
    "controllers": parse_names,
    "shard": _parse_shard,
    "side": lambda above: "high" if above else "low",
}


def _option(option: Option, *names: str, **settings: Any) -> Any:
    return typer.Option(*names, help=option.help, show_default=option.default or True, **settings)


def takes_options(request: type) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the fields of a request as options of a command.

    The decorated function receives the request and the values of its remaining options.
    """
    options = options_of(request)

    def decorate(function: Callable[..., None]) -> Callable[..., None]:
        def command(**values: Any) -> None:
            fields = {name: values.pop(name) for name in options if name in values}
            for name, value in fields.items():
                if value is not None and options[name].kind in _PARSERS:
                    fields[name] = _PARSERS[options[name].kind](value)
            if fields.get("output", ...) is None and options["output"].kind == "folder":
                subject = fields.get("metric") or fields["requirement"]
                name = f"{Path(fields['campaign']).stem}_{function.__name__}_{subject}"
                fields["output"] = campaign_folder(Path("reports") / name)
            function(request(**fields), **values)

        _, *further = inspect.signature(function).parameters.values()
        parameters = [
            _make_parameter(parameter, options[name])
            for name, parameter in inspect.signature(request).parameters.items()
            if options[name].kind
        ]
        described: Any = command
        described.__name__, described.__doc__ = function.__name__, function.__doc__
        described.__signature__ = inspect.Signature(
            [
                parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)
                for parameter in (*parameters, *further)
            ]
        )
        return command

    return decorate


def _make_parameter(parameter: inspect.Parameter, option: Option) -> inspect.Parameter:
    flag = f"--{parameter.name.replace('_', '-')}"
    kind, make = _KINDS.get(option.kind, (bool, lambda option: _option(option, flag)))
    if parameter.default is None:
        kind = kind | None
    elif option.kind == "folder":
        parameter = parameter.replace(default=None)
    declared = make(option)
    declared.hidden = parameter.name in _EXPERT
    return parameter.replace(annotation=Annotated[kind, declared])
