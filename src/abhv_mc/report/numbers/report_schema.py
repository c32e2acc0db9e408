"""The JSON Schema of report.json, made of the judgement and the topics' models."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeAlias, Union, get_args, get_origin, get_type_hints

from abhv_mc.report.numbers.judged import Judgement
from abhv_mc.topics.plain import DRAWN
from abhv_mc.topics.registry import BUILT_IN
from abhv_mc.topics.topic import user_topics

_PLAIN = {str: "string", int: "integer", bool: "boolean", NoneType: "null"}
_HASHES = {"type": "object", "additionalProperties": {"type": ["string", "null"]}}


Schema: TypeAlias = dict[str, Any]


def report_schema() -> Schema:
    """What stands in report.json; an infinite or missing number is null."""
    defs: dict[str, Schema] = {}
    held = {"judgement": _schema(Judgement, defs)} | {topic.name: _schema(topic.model, defs) for topic in BUILT_IN}
    users = {topic.name: _schema(topic.model, defs) for topic in user_topics()}
    text = {"type": ["string", "null"]}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "abhv-mc: the numbers of a report",
        "type": "object",
        "properties": {
            "format": {"type": "integer"}, "state": text, "digest": text, "key": {"type": "string"},
            "warnings": {"type": "array", "items": {"type": "string"}}, "baseline": {"type": "object"},
            "topics": {"type": "object", "properties": users},
            **dict.fromkeys(("files", "pages", "pictures"), _HASHES), **held,
        },
        "required": ["format", "state", "digest", "warnings", *held],
        "additionalProperties": False,
        "$defs": defs,
    }  # fmt: skip


def _schema(hint: Any, defs: dict[str, Schema]) -> Schema:
    """The schema of a type as :func:`abhv_mc.topics.plain.plain` writes its values; classes go to ``defs``."""
    origin, arguments = get_origin(hint), get_args(hint)
    if hint in _PLAIN:
        return {"type": _PLAIN[hint]}
    if hint is float:
        return {"type": ["number", "null"]}
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (Union, UnionType):
        return {"anyOf": [_schema(each, defs) for each in arguments]}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {"type": "object", "additionalProperties": _schema(arguments[1], defs)}
    if origin is tuple and arguments[-1] is not Ellipsis:
        items = [_schema(each, defs) for each in arguments]
        return {"type": "array", "prefixItems": items, "minItems": len(items), "maxItems": len(items)}
    if origin in (tuple, list):
        return {"type": "array", "items": _schema(arguments[0], defs)}
    if is_dataclass(hint):
        names = [field.name for field in fields(hint) if not field.metadata.get(DRAWN)]
    elif hasattr(hint, "_fields"):  # a named tuple
        names = list(hint._fields)
    else:
        return {}  # anything
    name = f"{hint.__module__}.{hint.__name__}"
    if name not in defs:
        defs[name] = {}
        hints = get_type_hints(hint)
        properties = {each: _schema(hints[each], defs) for each in names}
        defs[name] = {"type": "object", "properties": properties, "required": names, "additionalProperties": False}
    return {"$ref": f"#/$defs/{name}"}
