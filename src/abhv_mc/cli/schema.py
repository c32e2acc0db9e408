"""``abhv-mc schema``: a file's JSON Schema, for editors."""

from enum import StrEnum
from typing import Annotated

import typer


class Kind(StrEnum):
    """The kinds of input file."""

    campaign = "campaign"
    vehicle = "vehicle"
    mission = "mission"
    controller = "controller"


def command(kind: Annotated[Kind, typer.Argument(help="The kind of file.")]) -> None:
    """Print the JSON Schema of a kind of file."""
    from abhv_mc.campaign.file.schema import make_schema
    from abhv_mc.cli.printing import print_json

    print_json(make_schema(kind.value))
