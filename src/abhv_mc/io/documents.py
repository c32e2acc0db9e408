"""YAML documents as plain data that remember where each value stands, and their check against a model.

YAML 1.2, mappings with text keys only; no tags, no objects, no duplicate keys. A model is a
:class:`StrictModel`; what is wrong is said with file, line and column, everything at once.
"""

import sys
from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from io import StringIO
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import to_jsonable_python

from abhv_mc.io.document_reader import Place, Plain, compose
from abhv_mc.io.input_error import InputError, InputErrors, Refusal, describe, one_of
from abhv_mc.io.input_files import read_input

__all__ = [
    "Document",
    "File",
    "InputError",
    "InputErrors",
    "Refusal",
    "StrictModel",
    "describe",
    "one_of",
    "read_document",
    "validate",
    "write_document",
]

M = TypeVar("M", bound=BaseModel)
Key = str | int


@dataclass(frozen=True)
class Document:
    """A file's content as plain data. ``keys`` below lead from the root to a value."""

    path: Path
    data: Plain
    value_places: Mapping[tuple[Key, ...], Place] = field(repr=False)
    key_places: Mapping[tuple[Key, ...], Place] = field(repr=False)

    @property
    def entries(self) -> dict[str, Any]:
        """The data of a file that is a mapping."""
        data: Any = self.data
        return data

    def __str__(self) -> str:
        """The file that it stands for, as messages name it."""
        return str(self.path)

    def position(self, *keys: Key) -> Place:
        """Line and column (from 1) of the value at ``keys``, or of the nearest thing around it that exists."""
        while keys not in self.value_places:
            keys = keys[:-1]
        return self.value_places[keys]

    def key_position(self, *keys: Key) -> Place:
        """Line and column (from 1) of the key that ends ``keys``; of the value, where it is a list's item."""
        return self.key_places.get(keys) or self.position(*keys)

    def error(self, keys: tuple[Key, ...], found: str, expected: str) -> InputError:
        """What to raise when the value at ``keys`` is wrong."""
        return InputError(self.path, found, expected, *self.position(*keys))

    def key_error(self, keys: tuple[Key, ...], found: str, expected: str) -> InputError:
        """What to raise when the key that ends ``keys`` is wrong."""
        return InputError(self.path, found, expected, *self.key_position(*keys))

    def resolve(self, text: str | Path) -> Path:
        """A path written in the file, which is relative to the file's folder."""
        return self.path.parent / text


def read_document(path: "str | PathLike[str] | Document") -> Document:
    """Read one YAML file; a document is what was read already. Raises :class:`InputError`."""
    if isinstance(path, Document):
        return path
    path = Path(path)
    try:
        data, *places = compose(path, read_input(path))
    except FileNotFoundError:
        raise InputError(path, "no such file", "a YAML file") from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"a file that cannot be read ({error})", "a YAML file") from None
    return Document(path, deepcopy(data), *places)


def write_document(path: str | Path, data: Plain, comment: str = "") -> None:
    """Write plain data, numpy's scalars and paths (as text) among them. Raises :class:`InputError` for other data."""
    from ruamel.yaml import YAML

    def of_numpy(value: Any) -> Any:
        if type(value).__module__ != "numpy" or getattr(value, "ndim", False):
            raise InputError(path, f"a value of the type {type(value).__name__}", "plain data")
        return value.item()

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None  # innermost lists and mappings on one line
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.allow_unicode = False  # some line ends are not ASCII
    yaml.width = sys.maxsize  # ruamel folds some long texts so that they read back changed
    text = StringIO()
    text.writelines(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    yaml.dump(to_jsonable_python(data, fallback=of_numpy), text)
    Path(path).write_text(
        text.getvalue(), encoding="utf-8"
    )  # only now: refused data leave a file as it is


def _make_scalars_strict(schema: Any) -> None:
    if isinstance(schema, dict):
        if schema.get("type") in ("int", "float", "bool", "str"):
            schema["strict"] = True
        for key, part in schema.items():
            if key not in ("default", "metadata"):
                _make_scalars_strict(part)
    elif isinstance(schema, (list, tuple)):
        for part in schema:
            _make_scalars_strict(part)


class StrictModel(BaseModel):
    """Base of every model of a file: frozen, no unknown keys, finite numbers only, no number from text or text
    from a number (a list does become a tuple, and text a path).

    Its values come from :func:`validate`; a check of its own raises :class:`Refusal`.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=()
    )

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        schema = handler(source)
        _make_scalars_strict(schema)
        return schema

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        if (
            info.context and "known_keys" in info.context
        ):  # what an unknown key may have been meant to be
            info.context["known_keys"][id(data)] = [
                field.alias or name for name, field in cls.model_fields.items()
            ]
        return data


def _resolve_file(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        raise Refusal(describe(value), "the path of a file")
    document = (info.context or {}).get("document")
    path = document.resolve(value) if document else Path(value)
    if not path.is_file():
        raise Refusal(
            f"'{value}', which is {'a folder' if path.is_dir() else 'not there'}",
            "the path of a file",
        )
    return path


File = Annotated[Path, BeforeValidator(_resolve_file, json_schema_input_type=str)]
"""A field that names an existing file, relative to the document's folder; its value can be opened as it is."""


def validate(document: Document, model: type[M]) -> M:
    """The document's data as a ``model``. Raises :class:`InputErrors` with everything that is wrong, each in place.

    Validators find the document in ``info.context["document"]``.
    """
    known_keys: dict[int, list[str]] = {}
    try:
        return model.model_validate(
            document.data, context={"document": document, "known_keys": known_keys}
        )
    except ValidationError as error:
        details = error.errors(include_url=False, include_input=False)
    raise InputErrors([_explain(document, detail, known_keys) for detail in details])


def _locate(data: Any, location: tuple[Key, ...]) -> tuple[Key, ...]:
    """The part of pydantic's location that exists in the data; tags and types of unions are not in the data."""
    best: tuple[Key, ...] = ()
    if not isinstance(data, (dict, list)):
        return best
    for i, key in enumerate(location):
        inside = key in data if isinstance(data, dict) else isinstance(key, int) and key < len(data)
        if inside:
            inner: Any = data
            best = max(best, (key, *_locate(inner[key], location[i + 1 :])), key=len)
    return best


_EXPECTED = {  # where pydantic's own words are Python's
    "string_type": "text",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "none_required": "nothing",
}


def _explain(document: Document, detail: Any, known_keys: Mapping[int, list[str]]) -> InputError:
    """One of pydantic's errors as ours."""
    kind, location, context = detail["type"], tuple(detail["loc"]), detail.get("ctx", {})
    keys = _locate(document.data, location)
    value: Any = document.data
    around = value
    for key in keys:
        value, around = value[key], value
    cause = context.get("error")
    if isinstance(cause, Refusal):
        return document.error((*keys, *cause.keys), cause.found, cause.expected)
    if kind == "extra_forbidden":
        expected = (
            one_of(known_keys[id(around)], keys[-1]) if id(around) in known_keys else "no such key"
        )
        return document.key_error(keys, f"unknown key '{keys[-1]}'", expected)
    if location and location[-1] == "[key]":
        return document.key_error(keys, f"the key '{keys[-1]}'", _plain(detail["msg"]))
    if kind == "missing":
        return document.error(keys, f"no key '{location[-1]}'", f"'{location[-1]}' here")
    if kind.startswith("union_tag"):
        return _explain_tag(document, keys, value, context)
    if kind == "literal_error":
        choices = [
            word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")
        ]
        return document.error(keys, describe(value), one_of(choices, value))
    if kind == "too_short":
        return document.error(keys, describe(value), f"at least {context['min_length']} of them")
    return document.error(keys, describe(value), _EXPECTED.get(kind) or _plain(detail["msg"]))


def _explain_tag(document: Document, keys: tuple[Key, ...], value: Any, context: Any) -> InputError:
    """A union whose kind is named by a key, and the name is unknown or missing."""
    name = context["discriminator"].strip("'")
    name = "kind" if name.endswith("()") else name  # a function that looks for other keys first
    if "tag" in context:
        tags = [tag.strip("'") for tag in context["expected_tags"].split(", ")]
        return document.error(
            (*keys, name), f"{name} '{context['tag']}'", one_of(tags, context["tag"])
        )
    found = f"no key '{name}'" if isinstance(value, dict) else describe(value)
    return document.error(keys, found, f"a mapping with '{name}'")


def _plain(message: str) -> str:
    """Pydantic's sentence without its beginning."""
    message = message.removeprefix("Input should ").removeprefix("be ")
    return message[:1].lower() + message[1:]
