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

    from abhv_mc.campaign.file.inputs import MODELS

    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema"} | MODELS[kind.value].model_json_schema()
    print(json.dumps(schema, indent=2))
