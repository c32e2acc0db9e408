"""``abhv-mc list``: the campaigns that were flown."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.printing import say
from abhv_mc.io.input_error import InputError

_DEFAULT = Path("reports")


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that holds campaigns' folders.")] = _DEFAULT,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """List the campaigns in a folder: name, state, flights, when, and the digest's first digits."""
    from abhv_mc.cli.printing import print_json
    from abhv_mc.execution.status import find_campaigns

    if not folder.is_dir() and folder != _DEFAULT:
        raise InputError(folder, None, None, "no such folder", "one that holds campaigns' folders")
    found = find_campaigns(folder)
    if json:
        print_json(found)
        return
    if not found:
        say(f"no campaigns in {folder}")
    for status in found:
        flights = f"{status['runs_done']}/{status['runs_planned']}"
        names = ",".join(status["controllers"])
        words = (status["folder"], status["state"], flights, names, status["started"], str(status["digest"])[:12])
        say("{:<32} {:<12} {:>16}  {:<20} {:<26} {}".format(*words))
