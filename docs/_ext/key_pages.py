"""A page of keys for each kind of input file, from the schemas that the models make."""

from collections.abc import Iterator
from typing import Any

from tables import code, table

from abhv_mc.campaign.file.kinds import find_kinds
from abhv_mc.campaign.file.schema import make_schema
from abhv_mc.io.units import DIMENSIONS, dimension_of

_INTRODUCTIONS = {
    "campaign": "A campaign file states vehicle, mission, controllers, dispersions, number of "
    "flights and requirements.",
    "vehicle": "A vehicle file has the numbers of the vehicle, its tables, and the terms of its "
    "coefficients. The tutorial [A custom vehicle](../../../tutorials/own-vehicle.md) has a "
    "complete example, the axes and the signs.",
    "mission": "A mission file defines the start, the reference trajectory and the end of a "
    "flight.",
    "controller": "A controller file has a control law with its gains or weights. The defaults "
    "are those of the paper.",
}
_ENUMERATIONS = {  # named in words here: their tables have pages of their own
    "altitude_error_max_m": "a [metric](../metrics.md)",
    "atmosphere.density": "a [parameter](../parameters.md)",
    "altitude_m": "a [channel](../channels.md)",
}
Schema = dict[str, Any]


def _reference(schema: Schema) -> str | None:
    reference = schema.get("$ref")
    return reference.rsplit("/", 1)[1] if reference else None


def _bounds(schema: Schema) -> str:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    return ", ".join(
        f"{sign} {_number(schema[key])}" for key, sign in signs.items() if key in schema
    )


def _number(bound: float) -> str:
    """Return a bound as text, large powers of two as such."""
    is_power = isinstance(bound, int) and bound > 2**20 and not bound & (bound - 1)
    return f"2^{bound.bit_length() - 1}" if is_power else str(bound)


def _kind(schema: Schema) -> str:
    """Describe the allowed values of a key."""
    if name := _reference(schema):
        return f"[{name}](#{name.lower()})"
    if choices := schema.get("enum"):
        known = [words for member, words in _ENUMERATIONS.items() if member in choices]
        more = (
            [code(c) for c in choices if c == "all"]
            if known
            else [code(choice) for choice in choices]
        )
        return " or ".join([*more, *known] if known else more)
    if set(schema) == {"pattern"}:
        return (
            "a failure of one of the vehicle's effectors"
            if "failure" in schema["pattern"]
            else "a custom name"
        )
    if "const" in schema:
        return code(schema["const"])
    for several in ("oneOf", "anyOf"):
        if several in schema and "pattern" not in schema:
            kinds = dict.fromkeys(
                _kind(part) for part in schema[several] if part.get("type") != "null"
            )
            return " or ".join(
                kind
                for kind in kinds
                if not any(other.startswith(f"{kind} or ") for other in kinds)
            )
    if schema.get("type") == "array":
        if parts := schema.get("prefixItems"):
            return f"list of {len(parts)}: {_kind(parts[0])}"
        return f"list of {_kind(schema.get('items', {}))}"
    if schema.get("type") == "object":
        names = schema.get("propertyNames", {})
        keys = _kind(names) if names.get("anyOf") else "name"
        values = schema.get("additionalProperties") or next(
            iter(schema.get("patternProperties", {}).values()), None
        )
        return f"mapping from {keys} to {_kind(values) if isinstance(values, dict) else 'anything'}"
    if examples := schema.get("examples"):
        dimension = dimension_of(examples[0].split(" ", 1)[1])
        return (
            dimension.name.split(" ", 1)[1]
            if dimension in DIMENSIONS
            else f"text such as `{examples[0]}`"
        )
    words = {
        "integer": "whole number",
        "number": "number",
        "string": "text",
        "boolean": "true or false",
    }
    kind = words.get(schema.get("type", ""), "anything")
    return f"{kind} {bounds}" if (bounds := _bounds(schema)) else kind


def _default(schema: Schema, required: bool) -> str:
    if required:
        return "required"
    default = schema.get("default")
    if default is None or default in ([], {}, ""):
        return ""
    if isinstance(default, list) and len(default) > 5:
        return "all"
    return code(str(default).replace("'", "") if isinstance(default, list) else default)


def _keys(schema: Schema) -> str:
    required = schema.get("required", [])
    rows = (
        (code(key), _kind(part), _default(part, key in required), part["description"])
        for key, part in schema.get("properties", {}).items()
    )
    return table(("key", "type", "default", "meaning"), rows)


def _parts(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """Return the nested mappings in the order of their appearance."""
    known, seen = schema.get("$defs", {}), []

    def walk(part: Any) -> None:
        if isinstance(part, dict):
            name = _reference(part)
            if name and name not in seen:
                seen.append(name)
                walk(known[name])
            for key, value in part.items():
                if key not in ("$defs", "discriminator"):
                    walk(value)
        elif isinstance(part, list):
            for value in part:
                walk(value)

    walk(schema)
    return ((name, known[name]) for name in seen)


def _page(kind: str) -> str:
    schema = make_schema(kind)
    lines = [f"# {kind.capitalize()} file\n", _INTRODUCTIONS[kind] + "\n"]
    lines.append(
        f"A quantity includes its [unit](../units.md). `abhv-mc list schemas {kind}` prints "
        "these keys as a JSON Schema,"
    )
    lines.append("with which [an editor](../../../how-to/editors.md) completes and checks keys.\n")
    if "properties" in schema:
        lines.append(_keys(schema))
    for name, part in _parts(schema):
        text = " ".join(part.get("description", "").split()).replace("``", "`")
        lines += [f"## {name}\n", f"{text}\n", _keys(part)]
    return "\n".join(lines)


def make() -> dict[str, str]:
    """Return the pages by their path."""
    return {f"files/{kind}.md": _page(kind) for kind in find_kinds()}
