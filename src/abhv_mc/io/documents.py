"""YAML documents as plain data with source locations, and their validation.

The reader accepts YAML 1.2 with text keys only: no tags, objects or duplicate keys. Models are
subclasses of :class:`StrictModel`. All problems of a file are reported together, with file, line
and column.
"""

import ast
import functools
import inspect
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, replace
from io import StringIO
from itertools import pairwise
from numbers import Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
    model_validator,
)
from pydantic_core import to_jsonable_python

from abhv_mc.io.document_reader import Place, Plain, compose
from abhv_mc.io.input_files import read_input
from abhv_mc.io.messages import (
    InputError,
    InputErrors,
    Refusal,
    counted,
    found_value,
    one_of,
)
from abhv_mc.io.units import NUMBER

M = TypeVar("M", bound=BaseModel)
Key = str | int


@dataclass(frozen=True)
class Document:
    """Content of a file as plain data, with the source locations of keys and values.

    The argument ``keys`` of the methods is the path from the root to a value.
    """

    path: Path
    data: Plain
    value_places: Mapping[tuple[Key, ...], Place] = field(repr=False)
    key_places: Mapping[tuple[Key, ...], Place] = field(repr=False)
    # files named in this file whose entries are part of the data
    tables: tuple["Document", ...] = field(default=(), repr=False)

    @property
    def entries(self) -> dict[str, Any]:
        """Data of a file whose root is a mapping."""
        data: Any = self.data
        return data

    def __str__(self) -> str:
        """Return the path of the file."""
        return str(self.path)

    def position(self, *keys: Key) -> Place:
        """Return the line and column (from 1) of the value at ``keys`` or its nearest parent."""
        while keys not in self.value_places:
            keys = keys[:-1]
        return self.value_places[keys]

    def key_position(self, *keys: Key) -> Place:
        """Return the line and column (from 1) of the last key, or list item, in ``keys``."""
        return self.key_places.get(keys) or self.position(*keys)

    def error(self, keys: tuple[Key, ...], problem: str, expected: str) -> InputError:
        """Return the InputError for the value at ``keys``."""
        source = self._source(keys)
        return InputError(source.path, problem, expected, *source.position(*keys))

    def key_error(self, keys: tuple[Key, ...], problem: str, expected: str) -> InputError:
        """Return the InputError for the last key in ``keys``."""
        source = self._source(keys)
        return InputError(source.path, problem, expected, *source.key_position(*keys))

    def _source(self, keys: tuple[Key, ...]) -> "Document":
        """Return the table that contains the entry at ``keys``, or this document."""
        tables = self.tables if len(keys) > 1 else ()
        return next((table for table in tables if keys[:2] in table.value_places), self)

    def with_entries(self, entries: Mapping[str, Any]) -> "Document":
        """Return the document with changed entries, given by dotted keys.

        A number has the unit of the entry that it replaces. Raise InputError for a key within a
        value that is not a mapping.
        """
        data: Any = deepcopy(self.data)
        for key, value in entries.items():
            *path, last = key.split(".")
            try:
                node = functools.reduce(lambda node, name: node.setdefault(name, {}), path, data)
                old = node.get(last)
            except AttributeError:
                problem = f"unknown entry '{key}'"
                raise InputError(self.path, problem, "the key of a mapping") from None
            unit = isinstance(old, str) and re.fullmatch(f"{NUMBER}(.*)", old)
            node[last] = f"{value}{unit[1]}" if unit and isinstance(value, Real) else value
        return replace(self, data=data)

    def resolve(self, text: str | Path) -> Path:
        """Return the path ``text``, resolved relative to the folder of the file."""
        return self.path.parent / text


class Problems(list[InputError]):
    """Problems of a document, which are reported together."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self.document = document

    def add(self, keys: tuple[Key, ...], problem: str, expected: str) -> None:
        """Add a problem of the value at ``keys``."""
        self.append(self.document.error(keys, problem, expected))

    def add_key(self, keys: tuple[Key, ...], problem: str, expected: str) -> None:
        """Add a problem of the last key in ``keys``."""
        self.append(self.document.key_error(keys, problem, expected))

    @contextmanager
    def collect(self, *keys: Key) -> Iterator[None]:
        """Add a Refusal that is raised in the context as a problem of the value at ``keys``."""
        try:
            yield
        except Refusal as refusal:
            self.add((*keys, *refusal.keys), refusal.found, refusal.expected)


def read_document(path: "str | PathLike[str] | Document") -> Document:
    """Read a YAML file, or return a document unchanged. Raise InputError if invalid."""
    if isinstance(path, Document):
        return path
    path = Path(path)
    try:
        data, values, keys = compose(path, read_input(path))
    except FileNotFoundError:
        raise InputError(path, "no such file", "a YAML file") from None
    except IsADirectoryError:
        files = sorted(file.name for file in path.glob("*.yaml"))
        expected = f"a YAML file, such as {path / files[0]}" if files else "a YAML file"
        raise InputError(path, "found a folder", expected) from None
    except (OSError, ValueError) as error:
        raise InputError(path, f"the file cannot be read ({error})", "a YAML file") from None
    return Document(path, deepcopy(data), values, keys)


def write_document(path: str | Path, data: Plain, comment: str = "") -> None:
    """Write plain data, numpy scalars and paths to a YAML file.

    Raise InputError for values of other types.
    """
    from ruamel.yaml import YAML

    def of_numpy(value: Any) -> Any:
        if type(value).__module__ != "numpy" or getattr(value, "ndim", False):
            raise InputError(path, f"found a value of type {type(value).__name__}", "plain data")
        return value.item()

    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = None  # Innermost lists and mappings are written on one line.
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.allow_unicode = False  # Escape line separators that are not ASCII characters.
    yaml.width = sys.maxsize  # ruamel changes some long strings when it folds them.
    text = StringIO()
    text.writelines(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    yaml.dump(to_jsonable_python(data, fallback=of_numpy), text)
    # Write only at the end, so that invalid data leave an existing file unchanged.
    Path(path).write_text(text.getvalue(), encoding="utf-8")


def _make_scalars_strict(schema: Any, model: type) -> None:
    """Make the scalars in a model's schema strict.

    The schemas of nested models are skipped, because their scalars are already strict.
    """
    if isinstance(schema, dict):
        kind = schema.get("type")
        own = schema["cls"] if kind == "model" else model
        if own is not model and issubclass(own, StrictModel):
            return
        if kind in ("int", "float", "bool", "str"):
            schema["strict"] = True
        for key, subschema in schema.items():
            if key not in ("default", "metadata"):
                _make_scalars_strict(subschema, model)
    elif isinstance(schema, (list, tuple)):
        for subschema in schema:
            _make_scalars_strict(subschema, model)


class StrictModel(BaseModel):
    """Frozen base class of file models, which rejects unknown keys and nonfinite numbers.

    Text is not converted to numbers, and numbers are not converted to text. Lists become tuples,
    and texts in path fields become paths. Create instances with :func:`validate`. Validators raise
    :class:`Refusal`.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=(), defer_build=True
    )

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> Any:
        schema = handler(source)
        _make_scalars_strict(schema, cls)
        return schema

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: GetJsonSchemaHandler) -> Any:
        schema = handler(core)
        properties = handler.resolve_ref_schema(schema).get("properties", {})
        for base in filter(StrictModel.__subclasscheck__, cls.__mro__[::-1]):
            for (owner, name), text in _field_docstrings(base.__module__).items():
                if owner == base.__name__ and (field := cls.model_fields.get(name)):
                    properties[field.alias or name]["description"] = text
        return schema

    @model_validator(mode="before")
    @classmethod
    def _note_keys(cls, data: Any, info: ValidationInfo) -> Any:
        # Store the valid keys, to suggest one of them for a misspelt key.
        if info.context and "known_keys" in info.context:
            info.context["known_keys"][id(data)] = [
                field.alias or name for name, field in cls.model_fields.items()
            ]
        return data


@functools.cache
def _field_docstrings(module: str) -> dict[tuple[str, str], str]:
    """Return the docstrings of the fields of a module's classes, by class and field.

    They are the descriptions of the keys in a JSON Schema. Pydantic would read them, more slowly,
    on each import.
    """
    try:
        source = inspect.getsource(sys.modules[module])
    except (OSError, TypeError):  # interactive sessions and compiled modules
        return {}
    return {
        (owner.name, ast.unparse(field.target)): " ".join(ast.literal_eval(text.value).split())
        for owner in ast.walk(ast.parse(source))
        if isinstance(owner, ast.ClassDef)
        for field, text in pairwise(owner.body)
        if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr)
    }


class CommaKeys(StrictModel):
    """Keys beside a table's ``columns`` that state the meaning of commas in its numbers."""

    decimal: Literal[","] | None = None
    """`','` if 12,788 in the table is 12.788"""
    thousands: Literal[","] | None = None
    """`','` if 12,788 in the table is 12788"""

    @model_validator(mode="after")
    def _check_commas(self) -> Self:
        if self.decimal and self.thousands:
            raise Refusal(
                "commas have two meanings", "either 'decimal' or 'thousands'", ("thousands",)
            )
        return self

    @property
    def comma(self) -> str:
        """Key that is present, or '' if neither is."""
        return "decimal" if self.decimal else "thousands" if self.thousands else ""


def _resolve_file(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        raise Refusal(found_value(value), "the path of a file")
    document = (info.context or {}).get("document")
    path = document.resolve(value) if document else Path(value)
    if not path.is_file():
        raise Refusal(
            f"'{value}' {'is a folder' if path.is_dir() else 'does not exist'}",
            "the path of an existing file",
        )
    return path


File = Annotated[Path, BeforeValidator(_resolve_file, json_schema_input_type=str)]
"""Field that names an existing file, relative to the folder of the document."""

YesNo = Annotated[
    bool,
    BeforeValidator(
        lambda value: (
            {"yes": True, "no": False}.get(value, value) if isinstance(value, str) else value
        ),
        json_schema_input_type=bool | Literal["yes", "no"],
    ),
]


def validate(document: Document, model: type[M]) -> M:
    """Convert a document's data to a ``model``. Raise InputErrors with all problems.

    Validators can access the document as ``info.context["document"]``.
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
    """Return the keys of a pydantic location that exist in the data.

    Pydantic locations also contain the tags and types of unions, which are not in the data.
    """
    best: tuple[Key, ...] = ()
    if not isinstance(data, (dict, list)):
        return best
    for i, key in enumerate(location):
        inside = key in data if isinstance(data, dict) else isinstance(key, int) and key < len(data)
        if inside:
            inner: Any = data
            best = max(best, (key, *_locate(inner[key], location[i + 1 :])), key=len)
    return best


_EXPECTED = {  # replacements for Python terms in pydantic messages
    "string_type": "text",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "none_required": "nothing",
}


def _explain(document: Document, detail: Any, known_keys: Mapping[int, list[str]]) -> InputError:
    """Convert a pydantic error to an InputError."""
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
        names = known_keys.get(id(around))
        expected = one_of(names, keys[-1]) if names is not None else "no such key"
        return document.key_error(keys, f"unknown key '{keys[-1]}'", expected)
    if location and location[-1] == "[key]":
        return document.key_error(keys, f"the key '{keys[-1]}' is invalid", _plain(detail["msg"]))
    if kind == "missing":
        return document.error(
            keys, f"the key '{location[-1]}' is missing", f"a mapping with the key '{location[-1]}'"
        )
    if kind.startswith("union_tag"):
        return _explain_tag(document, keys, value, context)
    expected = _EXPECTED.get(kind) or _plain(detail["msg"])
    if kind == "literal_error":
        choices = context["expected"].replace(" or ", ", ").split(", ")
        expected = one_of([choice.strip("'") for choice in choices], value)
    if kind == "too_short":
        expected = f"at least {counted(context['min_length'], 'item')}"
    return document.error(keys, found_value(value), expected)


def _explain_tag(document: Document, keys: tuple[Key, ...], value: Any, context: Any) -> InputError:
    """Return the InputError for a union whose tag is unknown or missing."""
    name = context["discriminator"].strip("'")
    if name.endswith("()"):  # A function determines the tag.
        name = "kind"
    if tag := context.get("tag"):
        tags = [known.strip("'") for known in context["expected_tags"].split(", ")]
        return document.error((*keys, name), f"unknown {name} '{tag}'", one_of(tags, tag))
    problem = f"the key '{name}' is missing" if isinstance(value, dict) else found_value(value)
    return document.error(keys, problem, f"a mapping with the key '{name}'")


def _plain(message: str) -> str:
    """Return a pydantic message without its prefix "Input should be"."""
    message = message.removeprefix("Input should ").removeprefix("be ")
    if message.startswith(("greater than", "less than")):
        return f"a value {message}"
    return message[:1].lower() + message[1:]
