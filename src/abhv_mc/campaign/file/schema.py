"""JSON Schemas of the four kinds of input files, for editors and other programs.

The schemas that pydantic generates are extended: quantities have a pattern and defaults with units,
metrics and parameters are enumerated, and each schema has a name (``$id``). The pydantic models
check more constraints than a JSON Schema can express.
"""

import math
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from abhv_mc.campaign.file.config import Campaign
from abhv_mc.campaign.file.kinds import load_model
from abhv_mc.campaign.file.simulator import SimulatorCampaign
from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.metrics import MARGIN_NAMES, METRIC_INDEX
from abhv_mc.io.units import dimension_of, format_quantity, parse_quantity, parse_unit
from abhv_mc.plant.parameters import PARAMETERS
from abhv_mc.version import __version__

Schema = dict[str, Any]
_OWN_METRIC = "^[a-z][a-z0-9_]*$"
_OWN_CHANNEL = "^[a-z][a-z0-9_.]*$"
# Pattern of the parameters that other files define, such as settings of custom functions.
_OWN_PARAMETER = "^(failure|aerodynamics|propulsion|dynamics|law|initial)[.]"


class _Generator(GenerateJsonSchema):
    """Schema generator that omits all titles of keys, and defaults that are mappings."""

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False

    def default_schema(self, schema: Any) -> Schema:
        schema_of_default = super().default_schema(schema)
        default = schema_of_default.get("default")
        if default is None or isinstance(default, dict) or not _is_finite(default):
            return {key: value for key, value in schema_of_default.items() if key != "default"}
        return schema_of_default | {"default": _in_words(default, schema_of_default)}


def _is_finite(default: Any) -> bool:
    numbers = default if isinstance(default, (list, tuple)) else [default]
    return all(
        number is not None and math.isfinite(number)
        for number in numbers
        if not isinstance(number, str)
    )


def _in_words(default: Any, schema: Schema) -> Any:
    """Return a default value as it is written in a file, where quantities have units."""
    if isinstance(default, (list, tuple)):
        parts = schema.get("prefixItems") or [schema.get("items", {})] * len(default)
        return [
            _in_words(value, subschema) for value, subschema in zip(default, parts, strict=True)
        ]
    for subschema in (schema, *schema.get("anyOf", ())):
        if isinstance(default, float) and "examples" in subschema:
            return _quantity(default, subschema["examples"][0].split(" ", 1)[1])
    return default


def _quantity(value: float, unit: str) -> str | float:
    """Return the shortest string, in ``unit`` or SI, that converts back to the same value."""
    dimension = dimension_of(unit)
    texts = [f"{value / parse_unit(unit)[0]:.{digits}g} {unit}" for digits in range(1, 17)]
    if value == 0.0:
        texts.append(f"0 {dimension.unit}")
    read_back = [text for text in texts if parse_quantity(text, dimension) == value]
    return min([*read_back, format_quantity(value, dimension)], key=lambda text: len(str(text)))


def make_schema(kind: str) -> Schema:
    """Return the JSON Schema of campaign, vehicle, mission or controller files."""
    if kind == "campaign":
        either = TypeAdapter(Campaign | SimulatorCampaign).json_schema(schema_generator=_Generator)
        ours, own = either.pop("anyOf")
        schema = {
            **either,
            "if": {"anyOf": [{"required": ["simulator"]}, {"required": ["inputs"]}]},
            "then": own,
            "else": ours,
        }
        _enumerate(schema["$defs"])
    else:
        schema = load_model(kind).model_json_schema(schema_generator=_Generator)
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:abhv-mc:{__version__}:{kind}",
        "title": f"{kind} file of abhv-mc",
    }
    return head | {key: value for key, value in schema.items() if key not in head}


def _enumerate(parts: Schema) -> None:
    """Add enumerations of metrics, parameters and channels to a schema.

    Campaigns with custom metrics also accept other metric names.
    """
    campaign = parts["Campaign"]
    metrics = {"enum": [*METRIC_INDEX, *MARGIN_NAMES]}
    own = {"pattern": _OWN_METRIC}
    for subschema in parts.values():
        for key in {"metric", "by"} & set(subschema.get("properties", ())):
            subschema["properties"][key] |= {"anyOf": [metrics, own]}
    campaign["if"] = {"not": {"required": ["metrics"]}}
    campaign["then"] = {
        "properties": {"requirements": {"items": {"properties": {"metric": metrics}}}}
    }

    shipped = [parameter.name for parameter in PARAMETERS if "." in parameter.name]
    names: Schema = {"anyOf": [{"enum": shipped}, {"pattern": _OWN_PARAMETER}]}
    for key in ("dispersions", "unknowns", "derived"):
        campaign["properties"][key]["propertyNames"] = names
    parts["Correlation"]["properties"]["between"]["prefixItems"] = [{"type": "string", **names}] * 2
    for keep in ("KeepHistories", "KeepEnvelopes"):
        channel_name: Schema = {
            "type": "string",
            "anyOf": [{"enum": ["all", *CHANNEL_INDEX]}, {"pattern": _OWN_CHANNEL}],
        }
        parts[keep]["properties"]["channels"]["anyOf"] = [
            channel_name,
            {"type": "array", "items": channel_name},
        ]
