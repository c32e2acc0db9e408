"""``abhv-mc status``: what a campaign's folder holds."""

from pathlib import Path
from typing import Annotated

import typer

from abhv_mc.cli.printing import say


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A campaign's folder.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Say how far a campaign is, who flies it, and what was found so far."""
    from abhv_mc.cli.printing import print_json
    from abhv_mc.cli.run import describe_outcomes, describe_requirement
    from abhv_mc.execution.status import read_status

    status = read_status(folder)
    if json:
        print_json(status)
        return
    say(f"{status['name']}: {status['state']}, {status['runs_done']} of {status['runs_planned']} flights")
    if status["holder"]:
        say(f"  flown now by {status['holder']}")
    for name, facts in status["controllers"].items():
        say(f"  {name:<12} {facts['flights_done']} flown: {describe_outcomes(facts)}")
    for entry in status["requirements"]:
        say(f"  {describe_requirement(entry)}")
    say(f"  digest       {status['digest']}")
    say(f"  time flown   {status['wall_time_s']:.1f} s")
    say(f"  on disk      {status['bytes'] / 1e6:.1f} MB")
