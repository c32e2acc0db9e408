"""Command ``new`` for starting a campaign."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.options import output_folder
from abhv_mc.cli.printing import say
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.cli.options import NewVehicle


def new(
    folder: Annotated[
        Path,
        typer.Argument(
            callback=output_folder, metavar="DIR", help="New or empty folder for the files."
        ),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="NAME",
            help="Shipped campaign to start from, such as 'wide' or 'failures'.",
        ),
    ] = "s_manoeuvre",
    law: Annotated[
        bool, typer.Option("--law", help="Add a commented example of a custom control law.")
    ] = False,
    language: Annotated[
        str | None,
        typer.Argument(
            metavar="[LANGUAGE]",
            help="Language of the control law added by --law: python or c.",
            show_default="python",
        ),
    ] = None,
    vehicle: NewVehicle = None,
    tune: Annotated[
        bool, typer.Option("--tune", help="Add a list of parameters that 'abhv-mc tune' may vary.")
    ] = False,
    simulator: Annotated[
        str | None,
        typer.Option(
            "--simulator",
            metavar="KIND",
            help="Use a custom simulator, a Python function (python) or a program (command), "
            "instead of the built-in simulator.",
        ),
    ] = None,
) -> None:
    """Create a commented campaign file with vehicle, mission and controller files."""
    from abhv_mc_vehicle.new_campaign import write_new_campaign

    if simulator is not None:
        if law or tune or vehicle is not None:
            raise InputError(
                "--simulator",
                "the option cannot be combined with --law, --vehicle or --tune, which apply to the "
                "built-in simulator",
                "either --simulator or these options",
            )
        _begin_simulator(folder, simulator)
        return
    if language is not None and not law:
        raise InputError(language, "a language requires the option --law", f"--law {language}")
    law_language = (language or "python") if law else None
    campaign, *further_files = write_new_campaign(
        folder, source, law_language, vehicle=vehicle, tune=tune
    )
    say(f"Created {campaign}, further files: {len(further_files)}. Next:")
    if law:
        file = "my_law.c" if law_language == "c" else "my_law.py"
        test = "abhv-mc fly level --controllers control/my_law.yaml"
        say(f"  cd {folder} && {test}   # after each edit of {file}")
    if tune:
        command = f"abhv-mc tune {campaign.name} --controller tlc -o control/tlc_tuned.yaml"
        say(f"  cd {folder} && {command}")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")


def _begin_simulator(folder: Path, kind: str) -> None:
    from abhv_mc_vehicle.new_campaign import write_new_simulator

    campaign, *further_files = write_new_simulator(folder, kind)
    names = [file.name for file in further_files if file.suffix != ".json"]
    say(f"Created {', '.join([str(campaign), *names])}. Next:")
    if kind == "command" and "rocket" not in names:
        say(f"  cd {folder} && make   # install a C compiler first: cc was not found")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")
