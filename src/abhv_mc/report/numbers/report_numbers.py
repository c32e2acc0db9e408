"""Content of `report.json` and its JSON Schema.

The same folder always gives bit-identical numbers: seeds are fixed, and no number depends on the
time or the machine. Infinite and missing values are None.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

from abhv_mc.report.numbers.compare import Baseline
from abhv_mc.report.numbers.summary import summarize, warnings_of
from abhv_mc.topics.json_data import DRAWN, json_data
from abhv_mc.topics.registry import BUILT_IN
from abhv_mc.topics.section import Records
from abhv_mc.topics.topic import Models, user_topics

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


_PLAIN = {str: "string", int: "integer", bool: "boolean", NoneType: "null"}
_HASHES = {"type": "object", "additionalProperties": {"type": ["string", "null"]}}


Schema: TypeAlias = dict[str, Any]


def report_schema() -> Schema:
    """Return the JSON Schema of `report.json`; infinite and missing numbers are null."""
    defs: dict[str, Schema] = {}
    sections = {"summary": _schema(Records, defs)} | {
        topic.name: _schema(topic.model, defs) for topic in BUILT_IN
    }
    users = {topic.name: _schema(topic.model, defs) for topic in user_topics()}
    text = {"type": ["string", "null"]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "abhv-mc: the numbers of a report",
        "type": "object",
        "properties": {
            "format": {"type": "integer"},
            "state": text,
            "digest": text,
            "key": {"type": "string"},
            "code": {"type": "string"},
            "hash": {"type": "string"},
            "requirement_sets": {"type": "integer"},
            "warnings": {"type": "array", "items": {"type": "string"}},
            "baseline": {"type": "object"},
            "topics": {"type": "object", "properties": users},
            **dict.fromkeys(("files", "pages", "pictures"), _HASHES),
            **sections,
        },
        "required": ["format", "state", "digest", "warnings", *sections],
        "additionalProperties": False,
        "$defs": defs,
    }


def _schema(hint: Any, defs: dict[str, Schema]) -> Schema:
    """Return the JSON Schema of a type as ``json_data`` writes its values.

    Schemas of classes are added to ``defs``.
    """
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return {"type": _PLAIN[hint]}
    if hint is float:
        return {"type": ["number", "null"]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (Union, UnionType):
        return {"anyOf": [_schema(item, defs) for item in arguments]}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(arguments[1], defs)}
    if origin is tuple and arguments[-1] is not Ellipsis:
        items = [_schema(item, defs) for item in arguments]
        return {
            "type": "array",
            "prefixItems": items,
            "minItems": len(items),
            "maxItems": len(items),
        }
    if origin in (tuple, list):
        return {"type": "array", "items": _schema(arguments[0], defs)}
    if is_dataclass(hint):
        names = [field.name for field in fields(hint) if not field.metadata.get(DRAWN)]
    elif hasattr(hint, "_fields"):  # named tuple
        names = list(hint._fields)
    else:
        return {}  # Any value is valid.
    name = f"{hint.__module__}.{hint.__name__}"
    if name not in defs:
        defs[name] = {}
        hints = get_type_hints(hint)
        properties = {item: _schema(hints[item], defs) for item in names}
        defs[name] = {
            "type": "object",
            "properties": properties,
            "required": names,
            "additionalProperties": False,
        }
    return {"$ref": f"#/$defs/{name}"}
