"""YAML text to plain data and the places of its values; used through :mod:`abhv_mc.io.documents`."""

import math
import re
from pathlib import Path
from typing import Any, NoReturn

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from abhv_mc.io.input_error import InputError, describe, is_printable
from abhv_mc.io.unit_pattern import NUMBER

Place = tuple[int, int]
Plain = dict[str, Any] | list[Any] | str | int | float | bool | None
Places = dict[tuple[str | int, ...], Place]

MAX_BYTES = 2_000_000
MAX_VALUES = 10_000  # a hundred times the largest file that is shipped; aliases of aliases grow exponentially
MAX_DEPTH = 40
_MOST_DIGITS = 1000  # of a whole number; Python reads 4300

_DECIMAL = re.compile(NUMBER)
_TAG = "tag:yaml.org,2002:"


def compose(path: Path, raw: bytes) -> tuple[Plain, Places, Places]:
    """Data, places of the values and places of the keys of a file's bytes. Raises :class:`InputError`."""
    if len(raw) > MAX_BYTES:
        raise InputError(path, f"more than {MAX_BYTES} bytes", f"a YAML file of at most {MAX_BYTES} bytes")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, column = _place_of(raw[: error.start].decode("utf-8"))
        raise InputError(path, f"the byte 0x{raw[error.start]:02x}", "text in UTF-8", line, column) from None
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = _Bounded
    try:
        root = yaml.compose(text)
    except ReaderError as error:
        line, column = _place_of(text[: error.position])
        raise InputError(path, f"the character {text[error.position]!r}", "printable text", line, column) from None
    except _TooMuchError as error:
        raise InputError(path, error.found, error.expected, *error.place) from None
    except MarkedYAMLError as error:
        _refuse_syntax(path, error)
    except (YAMLError, ValueError, OverflowError) as error:  # the last: the escape of a character beyond all
        raise InputError(path, str(error).splitlines()[0], "YAML 1.2") from None
    if root is None:
        raise InputError(path, "an empty file", "a YAML mapping", 1, 1)
    builder = _Builder(path)
    return builder.build(root, ()), builder.values, builder.keys


def _place_of(before: str) -> Place:
    """Line and column, from 1, of what follows the text ``before``."""
    return before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1


def _refuse_syntax(path: Path, error: MarkedYAMLError) -> NoReturn:
    mark = error.problem_mark or error.context_mark
    line, column = (mark.line + 1, mark.column + 1) if mark else (None, None)
    problem = error.problem or error.context or "something"
    if "'\\t'" in problem:
        raise InputError(path, "a tab", "spaces, as YAML indents by spaces only", line, column) from None
    if "another document" in problem:
        raise InputError(path, "a second document", "one document in a file", line, column) from None
    expected = f"YAML 1.2 ({error.context})" if error.context else "YAML 1.2"
    raise InputError(path, problem.removeprefix("found "), expected, line, column) from None


class _TooMuchError(Exception):
    """More levels or values than a file may have."""

    def __init__(self, place: Place, found: str, expected: str) -> None:
        super().__init__(place, found, expected)
        self.place, self.found, self.expected = place, found, expected


class _Bounded(Composer):
    """Stops at the first level or value too many, before the time and the stack that they would take are spent."""

    _level = 0
    _count = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.parser.peek_event().start_mark
        place = mark.line + 1, mark.column + 1
        self._count += 1
        self._level += 1
        if self._level > MAX_DEPTH:
            raise _TooMuchError(place, "too many levels", f"at most {MAX_DEPTH}")
        if self._count > MAX_VALUES:
            raise _TooMuchError(place, f"more than {MAX_VALUES} keys and values", "fewer; tables go to a CSV file")
        node = super().compose_node(parent, index)
        self._level -= 1
        return node


class _Builder:
    """Turns ruamel's nodes into plain data, noting where each value and key stands."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.length = 0  # of all texts, those of aliases each time
        self.values: Places = {}
        self.keys: Places = {}

    def refuse(self, node: Node, found: str, expected: str) -> NoReturn:
        raise InputError(self.path, found, expected, *_start(node))

    def build(self, node: Node, keys: tuple[str | int, ...]) -> Plain:
        self.values[keys] = _start(node)
        if len(self.values) > MAX_VALUES:
            self.refuse(node, f"more than {MAX_VALUES} values", "fewer (an alias may have multiplied them)")
        if len(keys) > MAX_DEPTH:
            self.refuse(node, "too many levels", f"at most {MAX_DEPTH} (an alias may contain itself)")
        tag = str(node.tag)
        if isinstance(node, MappingNode) and tag == _TAG + "map":
            return self.mapping(node, keys)
        if isinstance(node, SequenceNode) and tag == _TAG + "seq":
            return [self.build(item, (*keys, i)) for i, item in enumerate(node.value)]
        if isinstance(node, ScalarNode):
            return self.scalar(node, tag)
        self.refuse(node, f"the tag {tag.replace(_TAG, '!!')}", "plain data without tags")

    def mapping(self, node: MappingNode, keys: tuple[str | int, ...]) -> dict[str, Any]:
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = self.scalar(key_node, str(key_node.tag)) if isinstance(key_node, ScalarNode) else None
            if not isinstance(key, str):
                self.refuse(key_node, f"the key {describe(key)}", "a name as the key (in quotes, if need be)")
            self.check_shown(key_node, key)
            place = (*keys, key)
            if key in result:
                line, _ = self.keys[place]
                self.refuse(key_node, f"the key '{key}' again", f"it once (it is in line {line} too)")
            self.keys[place] = _start(key_node)
            result[key] = self.build(value_node, place)
            if value_node.start_mark.index == value_node.end_mark.index:  # nothing there; the mark is in a later line
                self.values[place] = self.keys[place]
        return result

    def check_shown(self, node: ScalarNode, text: str, allowed: str = "") -> None:
        """Refuse characters that nothing shows, or that turn text around."""
        hidden = next((char for char in text if char not in allowed and not is_printable(char)), None)
        if hidden is not None:
            found = f"the character {ascii(hidden)[1:-1]} in a text"
            self.refuse(node, found, "text without characters that control a terminal or the direction of writing")

    def scalar(self, node: ScalarNode, tag: str) -> str | int | float | bool | None:
        text = str(node.value)
        self.length += len(text)
        if self.length > MAX_BYTES:
            self.refuse(node, f"more than {MAX_BYTES} characters", "fewer (an alias may have multiplied them)")
        kind = tag.removeprefix(_TAG)
        if kind in ("str", "timestamp", "merge", "value"):  # a date is text here, and so is "<<"
            self.check_shown(node, text, "\n\t")
            return text
        if kind == "null" and text.lower() in ("", "~", "null"):
            return None
        if kind == "bool" and text.lower() in ("true", "false"):
            return text.lower() == "true"
        if kind in ("int", "float"):
            number = float(text) if _DECIMAL.fullmatch(text) else math.nan
            whole = kind == "float" or (len(text) <= _MOST_DIGITS and text.lstrip("+-").isdecimal())
            if not (math.isfinite(number) and whole):
                self.refuse(node, describe(text), "a finite decimal number such as 1000 or 2.5e-3")
            return number if kind == "float" else int(text)
        if kind in ("null", "bool"):  # by a tag, or in YAML 1.1
            self.refuse(node, describe(text), "true, false or null, as YAML 1.2 writes them")
        self.refuse(node, f"the tag {tag.replace(_TAG, '!!')}", "plain data without tags")


def _start(node: Node) -> Place:
    return node.start_mark.line + 1, node.start_mark.column + 1
