"""Content of `report.json` and its JSON Schema.

The same folder always gives bit-identical numbers: seeds are fixed, and no number depends on the
time or the machine. Infinite and missing values are None.
"""

from typing import Any, TypeAlias

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema

from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.numbers.summary import summarize, warnings_of
from abhv_mc.topics.formatting import json_data
from abhv_mc.topics.registry import BUILT_IN
from abhv_mc.topics.topic import Models, Records

FORMAT = 3


def make_numbers(models: Models, baseline: Baseline | None = None) -> dict[str, Any]:
    """Return the content of `report.json`, including the comparison with a ``baseline``."""
    manifest, users = models.results.manifest, models.users
    return {
        "format": FORMAT,
        "state": manifest.state,
        "digest": manifest.digest,
        **({"requirement_sets": len(sets)} if (sets := manifest.requirement_sets) else {}),
        "warnings": warnings_of(models),
        "summary": json_data(summarize(models)),
        **{topic.name: json_data(models[topic]) for topic in BUILT_IN},
        **({"topics": {topic.name: json_data(models[topic]) for topic in users}} if users else {}),
        **({"baseline": json_data(baseline)} if baseline else {}),
    }


_HASHES = {"type": "object", "additionalProperties": {"type": ["string", "null"]}}
Schema: TypeAlias = dict[str, Any]


class _Generator(GenerateJsonSchema):
    """Schema generator for data that ``json_data`` writes."""

    def float_schema(self, schema: Any) -> Schema:
        return {"type": ["number", "null"]}

    def dataclass_schema(self, schema: Any) -> Schema:
        return super().dataclass_schema(schema) | {"additionalProperties": False}

    def field_is_required(self, field: Any, total: bool) -> bool:
        return True

    def field_title_should_be_set(self, schema: Any) -> bool:
        return False


def report_schema() -> Schema:
    """Return the JSON Schema of `report.json`; infinite and missing numbers are null."""
    models: dict[str, Any] = {"summary": Records, **{topic.name: topic.model for topic in BUILT_IN}}
    schemas, defs = TypeAdapter.json_schemas(
        [(name, "serialization", TypeAdapter(model)) for name, model in models.items()],
        schema_generator=_Generator,
    )
    text = {"type": ["string", "null"]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "abhv-mc: the numbers of a report",
        "type": "object",
        "properties": {
            "format": {"type": "integer"},
            "state": text,
            "digest": text,
            **{key: {"type": "string"} for key in ("key", "code", "hash")},
            "requirement_sets": {"type": "integer"},
            "warnings": {"type": "array", "items": {"type": "string"}},
            "baseline": {"type": "object"},
            "topics": {"type": "object"},
            **dict.fromkeys(("files", "pages", "pictures"), _HASHES),
            **{name: schema for (name, _), schema in schemas.items()},
        },
        "required": ["format", "state", "digest", "warnings", *models],
        "additionalProperties": False,
        **defs,
    }
