"""Functions that importers use to write Python modules.

Statements contain only text of the importer, identifiers and numbers. Text of the imported file
appears only in comments and docstrings, after :func:`abhv_mc.io.xml_reader.fold` has made it safe.
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
_LONGEST = 60  # maximum length of a name
_BUILTINS = frozenset(dir(builtins))
_UNEDITED = (
    "# A repeated import replaces this file unless it was edited. SHA-256 of the text above: "
)


class Line(NamedTuple):
    """Statement or header line with its comment and indentation."""

    text: str
    words: str = ""
    indent: str = ""


def call(function: str, arguments: Iterable[str]) -> str:
    """Return the source text of a function call."""
    return f"{function}({', '.join(arguments)})"


def define(head: str, docstring: str, body: Iterable[Line]) -> list[Line]:
    """Return the lines that define a function or class."""
    inner = [Line(f'"""{docstring}"""'), *body]
    return [Line(head), *(line._replace(indent=INDENT) for line in inner)]


def declare(field: str, comment: str, value: float | None = None) -> Line:
    """Return the line that declares a float field of a class."""
    return Line(f"{field}: float" + ("" if value is None else f" = {number(value)}"), comment)


def names_in(lines: Iterable[Line]) -> set[str]:
    """Return all names used in the statements."""
    tree = ast.parse("\n".join(line.indent + line.text for line in lines))
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def free_name(text: str, taken: Collection[str] = ()) -> str:
    """Return an unused Python name that equals ``text`` if possible, or else resembles it."""
    name = re.sub(r"\W", "_", text, flags=re.ASCII)[:_LONGEST]
    name = name if name[:1].isalpha() else f"x{name}"
    while (
        name in _BUILTINS or keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in taken
    ):
        name += "_"
    return name


def number(value: float) -> str:
    """Return a number as Python source."""
    return repr(float(value)).replace("inf", "1e309")


def sequence(values: Any) -> str:
    """Return nested sequences of numbers as source text of tuples."""
    return str(tuple(map(sequence, values))).replace("'", "") if np.ndim(values) else number(values)


def import_names(
    used: Collection[str], modules: Iterable[tuple[str, Iterable[str]]]
) -> Iterator[Line]:
    """Yield import lines for the used names; ``modules`` maps each module to its names."""
    for module, exported in modules:
        if imported := sorted(set(used) & set(exported)):
            yield Line(f"from {module} import {', '.join(imported)}")


def lay_out(docstring: str, statements: Iterable[Line]) -> str:
    """Return the text of a module, with at most ``WIDTH`` characters per line if possible."""
    lines = [f'"""{docstring}\n"""']
    before = ""
    for text, comment, indent in statements:
        kind = next(
            (kind for kind in ("from", "@", "class", "def") if text.startswith(kind)), "name"
        )
        broken = [indent + text] if text.startswith('"""') else _break(text, indent)
        beside = f"{broken[0]}  # {comment}" if comment else broken[0]
        above = textwrap.wrap(
            comment, WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# "
        )
        if len(broken) == 1 and len(beside) <= WIDTH:
            broken = [beside]
            above = []
        if not indent and kind in ("@", "class", "def"):
            lines += ["", ""] if before != "@" else []
        elif not indent and (above or kind != before):
            lines.append("")
        lines += above + broken
        before = indent + kind
    return "\n".join(lines) + "\n"


def _break(text: str, indent: str) -> list[str]:
    """Return the lines of a statement; long statements are broken within brackets."""
    if len(indent + text) <= WIDTH:
        return [indent + text]
    first = text.index("(") + 1
    last = text.rindex(")")
    inner = indent + INDENT
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
        *(line for argument in parts for line in wrapper.wrap(argument)),
        indent + text[last:],
    ]


def write_unless_edited(
    folder: Path, texts: Mapping[str, str]
) -> tuple[list[Path], tuple[Path, ...]]:
    """Write files that end with a hash of their text, without replacing edited files.

    The new version of an edited file is written next to it.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    edited = []
    for name, text in texts.items():
        path = folder / name
        if path.exists() and _is_edited(path):
            edited.append(path)
            path = path.with_suffix(f".new{path.suffix}")
        write_text(path, text + _UNEDITED + hashlib.sha256(text.encode()).hexdigest() + "\n")
        paths.append(path)
    return paths, tuple(edited)


def _is_edited(path: Path) -> bool:
    text, mark, digest = path.read_text("utf-8").rpartition(_UNEDITED)
    return not mark or hashlib.sha256(text.encode()).hexdigest() != digest.strip()


def write_text(path: Path, text: str) -> None:
    """Write a file atomically."""
    with atomic_write(path) as temporary:
        temporary.write_text(text, "utf-8")
