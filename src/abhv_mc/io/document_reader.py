"""Parser for YAML text that returns plain data with source locations.

Other modules should use :mod:`abhv_mc.io.documents` instead.
"""

import math
import re
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from abhv_mc.io.messages import InputError, describe, found_value, grouped_digits, is_printable
from abhv_mc.io.units import NUMBER

Place = tuple[int, int]
Plain = dict[str, Any] | list[Any] | str | int | float | bool | None
Places = dict[tuple[str | int, ...], Place]

MAX_BYTES = 2_000_000
# maximum number of values in a file, which prevents exponential growth by nested YAML aliases
MAX_VALUES = 100_000

_CAPACITY = 64  # number of parsed files in the cache
_parsed: dict[bytes, tuple[Plain, Places, Places]] = {}
_DECIMAL = re.compile(NUMBER)
_TAG = "tag:yaml.org,2002:"


def compose(path: Path, raw: bytes) -> tuple[Plain, Places, Places]:
    """Parse a file; return data and locations of values and keys. Raise InputError if invalid.

    The result is cached by content, because a results folder contains copies of its input files.
    """
    if raw not in _parsed:
        if len(_parsed) == _CAPACITY:
            _parsed.clear()
        _parsed[raw] = _parse(path, raw)
    return _parsed[raw]


def _parse(path: Path, raw: bytes) -> tuple[Plain, Places, Places]:
    if len(raw) > MAX_BYTES:
        raise InputError(
            path,
            f"the file has more than {grouped_digits(MAX_BYTES)} bytes",
            f"a YAML file of at most {grouped_digits(MAX_BYTES)} bytes",
        )
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = _place_of(raw[: error.start].decode("utf-8"))
        raise InputError(
            path, f"found the byte 0x{raw[error.start]:02x}", "text in UTF-8", line, column
        ) from None
    builder = _Builder(path)
    try:
        root = YAML(typ="safe", pure=True).compose(text)
        if root is None:
            raise InputError(path, "the file is empty", "a YAML mapping", 1, 1)
        return builder.build(root, ()), builder.values, builder.keys
    except ReaderError as error:
        line, column = _place_of(text[: error.position])
        raise InputError(
            path, f"found the character {text[error.position]!r}", "printable text", line, column
        ) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        location = (mark.line + 1, mark.column + 1) if mark else ()
        if mark and text[mark.index : mark.index + 1] == "\t":
            raise InputError(path, "found a tab", "indentation by spaces", *location) from None
        if error.problem == "mapping values are not allowed here":
            expected = "quotes around text that contains a colon, or only one key per line"
            raise InputError(path, "the line has a second colon", expected, *location) from None
        separator = ", " if str(error.problem).startswith("but ") else ": "
        reason = separator.join(text for text in (error.context, error.problem) if text)
        raise InputError(path, f"invalid YAML ({reason})", "YAML 1.2", *location) from None
    except RecursionError:
        raise InputError(
            path, "the data have too many nested levels", "less deeply nested data"
        ) from None
    # An escape sequence beyond the range of Unicode raises OverflowError.
    except (YAMLError, ValueError, OverflowError) as error:
        raise InputError(
            path, f"invalid YAML ({str(error).splitlines()[0].rstrip('.')})", "YAML 1.2"
        ) from None


def _place_of(before: str) -> Place:
    """Return the line and column (from 1) of the text that follows ``before``."""
    return before.count("\n") + 1, len(before) - before.rfind("\n")


class _Builder:
    """Builder of plain data from ruamel nodes, with the locations of values and keys."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.values: Places = {}
        self.keys: Places = {}

    def refuse(self, node: Node, problem: str, expected: str) -> NoReturn:
        raise InputError(self.path, problem, expected, *_start(node))

    def build(self, node: Node, keys: tuple[str | int, ...]) -> Plain:
        self.values[keys] = _start(node)
        if len(self.values) > MAX_VALUES:
            self.refuse(
                node,
                f"the file has more than {grouped_digits(MAX_VALUES)} values",
                "fewer values (tables can be stored in CSV files)",
            )
        tag = str(node.tag)
        if isinstance(node, MappingNode) and tag == _TAG + "map":
            return self.mapping(node, keys)
        if isinstance(node, SequenceNode) and tag == _TAG + "seq":
            return [self.build(item, (*keys, i)) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return self.scalar(node, tag)
        self.refuse(node, f"found the tag {tag.replace(_TAG, '!!')}", "plain data without tags")

    def mapping(self, node: MappingNode, keys: tuple[str | int, ...]) -> dict[str, Any]:
        result = {}
        for key_node, value_node in node.value:
            is_scalar = isinstance(key_node, ScalarNode)
            key = self.scalar(key_node, str(key_node.tag)) if is_scalar else None
            if not isinstance(key, str):
                problem = f"the key {describe(key)} is not a name"
                self.refuse(key_node, problem, "a name as the key, in quotes if necessary")
            self.check_shown(key_node, key)
            path = (*keys, key)
            if key in result:
                expected = f"a unique key (line {self.keys[path][0]} contains the same key)"
                self.refuse(key_node, f"the key '{key}' is repeated", expected)
            self.keys[path] = _start(key_node)
            result[key] = self.build(value_node, path)
            # ruamel marks an empty value on a line after its key.
            if value_node.start_mark.index == value_node.end_mark.index:
                self.values[path] = self.keys[path]
        return result

    def check_shown(self, node: ScalarNode, text: str, allowed: str = "") -> None:
        """Reject invisible characters and characters that change the writing direction."""
        for char in text:
            if char not in allowed and not is_printable(char):
                self.refuse(
                    node,
                    f"the text contains the character {ascii(char)[1:-1]}",
                    "text without control characters or characters that change the writing "
                    "direction",
                )

    def scalar(self, node: ScalarNode, tag: str) -> str | int | float | bool | None:
        text = str(node.value)
        kind = tag.removeprefix(_TAG)
        if kind in ("str", "timestamp", "merge", "value"):  # Dates and "<<" are read as text.
            self.check_shown(node, text, "\n\t")
            return text
        if kind == "null" and text.lower() in ("", "~", "null"):
            return None
        if kind == "bool" and text.lower() in ("true", "false"):
            return text.lower() == "true"
        if kind in ("int", "float"):
            number = float(text) if _DECIMAL.fullmatch(text) else math.nan
            if not math.isfinite(number) or (kind == "int" and not text.lstrip("+-").isdecimal()):
                self.refuse(
                    node, found_value(text), "a finite decimal number such as 1000 or 2.5e-3"
                )
            return number if kind == "float" else int(text)
        self.refuse(node, f"found the tag {tag.replace(_TAG, '!!')}", "plain data without tags")


def _start(node: Node) -> Place:
    return node.start_mark.line + 1, node.start_mark.column + 1
