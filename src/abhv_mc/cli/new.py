"""``abhv-mc new``: a folder to start from."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.outputs import output_folder
from abhv_mc.cli.printing import say
from abhv_mc.io.input_error import InputError


def command(
    folder: Annotated[Path, typer.Argument(callback=output_folder, metavar="DIR", help="A new or an empty folder.")],
    source: Annotated[
        str, typer.Option("--from", metavar="NAME", help="Name of a shipped campaign, such as wide or failures.")
    ] = "s_manoeuvre",
    law: Annotated[bool, typer.Option("--law", help="Add a commented control law of your own.")] = False,
    language: Annotated[
        str | None, typer.Argument(metavar="[LANGUAGE]", help="Of the law: python or c.", show_default="python")
    ] = None,
    simulator: Annotated[
        str | None,
        typer.Option("--simulator", metavar="KIND", help="A simulator of your own instead: python or command."),
    ] = None,
) -> None:
    """Write a commented campaign with its vehicle, mission and control files to start from."""
    from abhv_mc.simulators.new_campaign import write_new_campaign

    if simulator is not None:
        _begin_simulator(folder, simulator, law)
        return
    if language is not None and not law:
        raise InputError(language, "a language without --law", "--law before it")
    chosen = (language or "python") if law else None
    campaign, *others = write_new_campaign(folder, source, chosen)
    say(f"{campaign} and {len(others)} files that it needs. Next:")
    if law:
        file = "my_law.c" if chosen == "c" else "my_law.py"
        say(f"  cd {folder} && abhv-mc fly level --controllers control/my_law.yaml   # after each edit of {file}")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")


def _begin_simulator(folder: Path, kind: str, law: bool) -> None:
    from abhv_mc.simulators.new_simulator import write_new_simulator

    if law:
        raise InputError("--simulator", "it beside --law", "one of both: a law flies this program's vehicles")
    campaign, *others = write_new_simulator(folder, kind)
    names = [file.name for file in others if file.suffix != ".json"]
    say(f"{campaign} and {', '.join(names)}. Next:")
    if kind == "command" and "rocket" not in names:
        say(f"  cd {folder} && make   # no C compiler was found here: it needs one, by the name cc")
    say(f"  cd {folder} && abhv-mc run {campaign.name}")
