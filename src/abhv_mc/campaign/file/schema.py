"""The JSON Schemas of the four kinds of input file, for editors and other programs.

They are the models' own, and say more: quantities have a pattern and defaults with their unit, metrics and parameters
are enumerated, and each schema has a name (``$id``). The models check more than a schema can.
"""

import math
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from abhv_mc import __version__
from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.kinds import MODELS
from abhv_mc.campaign.file.simulator import SimulatorCampaign
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.metrics import MARGIN_NAMES, METRIC_INDEX
from abhv_mc.io.units import dimension_of, format_quantity, parse_quantity, parse_unit
from abhv_mc.plant.parameters import PARAMETERS

Schema = dict[str, Any]
_OWN_METRIC = "^[a-z][a-z0-9_]*$"
_FAILURE = "^failure[.]"  # of an effector that the vehicle's file names


class _Generator(GenerateJsonSchema):
    """Without titles of keys, which only repeat them, and without defaults that are whole mappings."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def default_schema(self, schema: Any) -> Schema:
        made = super().default_schema(schema)
        default = made.get("default")
        if default is None or isinstance(default, dict) or not _is_finite(default):
            return {key: value for key, value in made.items() if key != "default"}
        return made | {"default": _in_words(default, made)}


def _is_finite(default: Any) -> bool:
    numbers = default if isinstance(default, (list, tuple)) else [default]
    return all(
        number is not None and math.isfinite(number)
        for number in numbers
        if not isinstance(number, str)
    )


def _in_words(default: Any, schema: Schema) -> Any:
    """The default as it would stand in the file: a quantity with its unit."""
    if isinstance(default, (list, tuple)):
        parts = schema.get("prefixItems") or [schema.get("items", {})] * len(default)
        return [_in_words(value, part) for value, part in zip(default, parts, strict=True)]
    for part in (schema, *schema.get("anyOf", ())):
        if isinstance(default, float) and "examples" in part:
            return _quantity(default, part["examples"][0].split(" ", 1)[1])
    return default


def _quantity(value: float, unit: str) -> str | float:
    """The shortest text, in this unit or in SI, that is read back as the value."""
    dimension = dimension_of(unit)
    texts = [f"{value / parse_unit(unit)[0]:.{digits}g} {unit}" for digits in range(1, 17)]
    if value == 0.0:
        texts.append(f"0 {dimension.unit}")
    read_back = [text for text in texts if parse_quantity(text, dimension) == value]
    return min([*read_back, format_quantity(value, dimension)], key=lambda text: len(str(text)))


def make_schema(kind: str) -> Schema:
    """The schema of a kind of file: campaign, vehicle, mission or controller."""
    if kind == "campaign":
        either = TypeAdapter(Campaign | SimulatorCampaign).json_schema(schema_generator=_Generator)
        ours, own = either.pop("anyOf")
        made = {
            **either,
            "if": {"anyOf": [{"required": ["simulator"]}, {"required": ["inputs"]}]},
            "then": own,
            "else": ours,
        }
        _enumerate(made["$defs"])
    else:
        made = MODELS[kind].model_json_schema(schema_generator=_Generator)
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:abhv-mc:{__version__}:{kind}",
        "title": f"{kind} file of abhv-mc",
    }
    return head | {key: value for key, value in made.items() if key not in head}


def _enumerate(parts: Schema) -> None:
    """Name metrics, parameters and channels. Without metrics of its own a campaign has those of the program alone."""
    campaign = parts["Campaign"]
    metrics = {"enum": [*METRIC_INDEX, *MARGIN_NAMES]}
    own = {"pattern": _OWN_METRIC}
    for part in parts.values():
        for key in {"metric", "by"} & set(part.get("properties", ())):
            part["properties"][key] |= {"anyOf": [metrics, own]}
    campaign["if"] = {"not": {"required": ["metrics"]}}
    campaign["then"] = {
        "properties": {"requirements": {"items": {"properties": {"metric": metrics}}}}
    }

    names = {"enum": [parameter.name for parameter in PARAMETERS if "." in parameter.name]}
    for key in ("dispersions", "unknowns", "derived"):
        campaign["properties"][key]["propertyNames"] = {"anyOf": [names, {"pattern": _FAILURE}]}
    parts["Correlation"]["properties"]["between"]["prefixItems"] = [{"type": "string", **names}] * 2
    for keep in ("KeepHistories", "KeepEnvelopes"):
        one: Schema = {"type": "string", "anyOf": [{"enum": ["all", *CHANNEL_INDEX]}, own]}
        parts[keep]["properties"]["channels"]["anyOf"] = [one, {"type": "array", "items": one}]
