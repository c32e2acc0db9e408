"""``abhv-mc parameters``: what a campaign may disperse."""

from typing import Annotated

import typer

from abhv_mc.cli.printing import say


def command(json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """Print every dispersible parameter: name, unit, nominal value, meaning. A unit of - is a factor or a number."""
    from dataclasses import asdict

    from abhv_mc.cli.printing import print_json
    from abhv_mc.plant.parameters import PARAMETERS

    listed = PARAMETERS[1:]  # the first is no parameter of a vehicle
    if json:
        print_json([asdict(parameter) for parameter in listed])
        return
    for parameter in listed:
        say(f"{parameter.name:<36} {parameter.unit:>6} {parameter.nominal:>4g}  {parameter.doc}")
