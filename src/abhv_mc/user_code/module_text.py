"""Python modules that an importer writes of another format: names, numbers, statements, lay-out, files.

A statement is of the importer's own words, of identifiers and of numbers. The words of what is imported are comments
and docstrings, which :func:`abhv_mc.io.xml_reader.fold` has made to end neither.
"""

import ast
import builtins
import hashlib
import keyword
import re
import textwrap
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.io.atomic_write import atomic_write

WIDTH = 116
INDENT = "    "
_LONGEST = 60  # letters of a name
_BUILTINS = frozenset(dir(builtins))
_UNEDITED = "# A second import replaces this file unless it is edited. SHA-256 of the text above: "


class Line(NamedTuple):
    """A statement or head, and the words about it: one line, printable."""

    text: str
    words: str = ""
    indent: str = ""


def call(function: str, arguments: Iterable[str]) -> str:
    """A call."""
    return f"{function}({', '.join(arguments)})"


def define(head: str, docstring: str, body: Iterable[Line]) -> list[Line]:
    """A function or class of the module."""
    inner = [Line(f'"""{docstring}"""'), *body]
    return [Line(head), *(line._replace(indent=INDENT) for line in inner)]


def declare(field: str, words: str, value: float | None = None) -> Line:
    """A field of a class of floats."""
    return Line(f"{field}: float" + ("" if value is None else f" = {number(value)}"), words)


def names_in(lines: Iterable[Line]) -> set[str]:
    """Every name that is read."""
    tree = ast.parse("\n".join(line.indent + line.text for line in lines))
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def free_name(text: str, taken: Collection[str] = ()) -> str:
    """A Python name for a text, its own where that is possible."""
    found = re.sub(r"\W", "_", text, flags=re.ASCII)[:_LONGEST]
    found = found if found[:1].isalpha() else f"x{found}"
    while (
        found in _BUILTINS
        or keyword.iskeyword(found)
        or keyword.issoftkeyword(found)
        or found in taken
    ):
        found += "_"
    return found


def number(value: float) -> str:
    """A number as Python reads it."""
    return repr(float(value)).replace("inf", "1e309")


def sequence(values: Any) -> str:
    """Numbers, however nested, as tuples."""
    return str(tuple(map(sequence, values))).replace("'", "") if np.ndim(values) else number(values)


def import_names(
    used: Collection[str], modules: Iterable[tuple[str, Iterable[str]]]
) -> Iterator[Line]:
    """The lines that import what is used of modules, each given with its names."""
    for module, known in modules:
        if found := sorted(set(used) & set(known)):
            yield Line(f"from {module} import {', '.join(found)}")


def lay_out(docstring: str, statements: Iterable[Line]) -> str:
    """The text of a module, in lines of at most ``WIDTH`` where that is possible."""
    lines, before = [f'"""{docstring}\n"""'], ""
    for text, words, indent in statements:
        kind = next(
            (kind for kind in ("from", "@", "class", "def") if text.startswith(kind)), "name"
        )
        broken = [indent + text] if text.startswith('"""') else _break(text, indent)
        beside = f"{broken[0]}  # {words}" if words else broken[0]
        above = textwrap.wrap(
            words, WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "
        )
        if len(broken) == 1 and len(beside) <= WIDTH:
            broken, above = [beside], []
        if not indent and kind in ("@", "class", "def"):
            lines += ["", ""] if before != "@" else []
        elif not indent and (above or kind != before):
            lines.append("")
        lines += above + broken
        before = indent + kind
    return "\n".join(lines) + "\n"


def _break(text: str, indent: str) -> list[str]:
    """A statement on lines of its own; one that is too long is broken within its brackets, which its first opens."""
    if len(indent + text) <= WIDTH:
        return [indent + text]
    first, last, inner = text.index("(") + 1, text.rindex(")"), indent + INDENT
    parts = text[first:last].replace(", (", ",\n(").split("\n")
    wrapper = textwrap.TextWrapper(
        WIDTH,
        initial_indent=inner,
        subsequent_indent=inner,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [
        indent + text[:first],
        *(line for part in parts for line in wrapper.wrap(part)),
        indent + text[last:],
    ]


def write_unless_edited(
    folder: Path, texts: Mapping[str, str]
) -> tuple[list[Path], tuple[Path, ...]]:
    """Write files that end with a hash of their text; leave one whose hash is not right, and write beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    paths, kept = [], []
    for name, text in texts.items():
        path = folder / name
        if path.exists() and _is_edited(path):
            kept.append(path)
            path = path.with_suffix(f".new{path.suffix}")
        write_text(path, text + _UNEDITED + hashlib.sha256(text.encode()).hexdigest() + "\n")
        paths.append(path)
    return paths, tuple(kept)


def _is_edited(path: Path) -> bool:
    text, mark, digest = path.read_text(encoding="utf-8").rpartition(_UNEDITED)
    return not mark or hashlib.sha256(text.encode()).hexdigest() != digest.strip()


def write_text(path: Path, text: str) -> None:
    """A file, whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
