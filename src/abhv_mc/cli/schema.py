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
    import json

    from abhv_mc.campaign.file.schema import make_schema

    print(json.dumps(make_schema(kind.value), indent=2))
