"""Reader of XML files that returns nodes with line numbers.

External references are never followed. Document types are skipped. Entity declarations, entity
references and inclusions are rejected. Text is returned as one line without quotes, so that it
cannot end the comment, docstring or YAML line into which an importer writes it.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

from abhv_mc.io.messages import InputError

_INCLUDE = "http://www.w3.org/2001/XInclude"
_DEEPEST = 200  # maximum depth of nested elements
_SEPARATOR = "\n"  # separator of namespace and name, which cannot occur in a name
_QUOTES = str.maketrans('"\\', "'/")


def fold(text: str) -> str:
    """Return the text as one line, without quotes and control characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in text.translate(_QUOTES)).split())


@dataclass
class Node:
    """XML element: name without namespace, attributes, children and text."""

    path: Path  # path of the file
    name: str
    attributes: dict[str, str]
    line: int
    column: int
    children: list["Node"] = field(default_factory=list)
    raw: str = ""  # original text, which may span several lines

    @cached_property
    def text(self) -> str:
        """Text of the element as one line, without quotes and control characters."""
        return fold(self.raw)

    @property
    def lines(self) -> list[str]:
        """Nonblank lines of the text, without quotes and control characters."""
        return [line for line in map(fold, self.raw.splitlines()) if line]

    def first(self, name: str) -> "Node | None":
        """Return the first child with the given name, or None."""
        return next((child for child in self.children if child.name == name), None)

    def all(self, *names: str) -> list["Node"]:
        """Return the children with the given names, in document order."""
        return [child for child in self.children if child.name in names]

    def words(self, name: str) -> str:
        """Return the text of a child, or '' if there is no such child."""
        child = self.first(name)
        return child.text if child else ""

    def refuse(self, problem: str, expected: str) -> InputError:
        """Return the InputError for a problem of the element."""
        return InputError(self.path, problem, expected, self.line, self.column)

    def number(self, text: str) -> float:
        """Convert text from the element to a number. Raise InputError if it is not a number."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isnan(value):
            raise self.refuse(f"found '{text}'", "a number")
        return value

    def bound(self, name: str) -> float | None:
        """Return an attribute as a number, or None if it is missing."""
        return self.number(self.attributes[name]) if name in self.attributes else None


def read_xml(path: Path, kind: str, name: str = "") -> tuple[Node, bytes]:
    """Return a file's root element and bytes.

    Raise InputError if the file is invalid, or if its root element does not have the given name.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(path, f"the file cannot be read ({error.strerror})", kind) from None
    parser = expat.ParserCreate(namespace_separator=_SEPARATOR)
    parser.buffer_text = True
    parents = [Node(path, "", {}, 0, 0)]  # parents of the current element; the first is no element

    def refuse(problem: str) -> NoReturn:
        location = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        raise InputError(path, problem, f"{kind} without external references", *location)

    def start(name: str, attributes: dict[str, str]) -> None:
        space, _, plain = name.rpartition(_SEPARATOR)
        if space == _INCLUDE:
            refuse("the file includes another file")
        if len(parents) > _DEEPEST:
            refuse(f"elements are nested more than {_DEEPEST} levels deep")
        bare = {key.rpartition(_SEPARATOR)[2]: fold(value) for key, value in attributes.items()}
        location = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        parents[-1].children.append(Node(path, plain, bare, *location))
        # A space separates the two numbers in content such as 1<sep/>3.
        parents[-1].raw += " "
        parents.append(parents[-1].children[-1])

    def add(text: str) -> None:
        parents[-1].raw += text

    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _: parents.pop()
    parser.CharacterDataHandler = add
    parser.EntityDeclHandler = lambda name, *_: refuse(f"the file declares the entity '{name}'")
    parser.SkippedEntityHandler = lambda name, _: refuse(
        f"the file uses the undeclared entity '{name}'"
    )
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        problem = f"invalid XML ({expat.ErrorString(error.code)})"
        raise InputError(path, problem, kind, error.lineno, error.offset + 1) from None
    (root,) = parents[0].children
    if name not in ("", root.name):
        raise root.refuse(f"found the element '{root.name}'", f"the element '{name}' of {kind}")
    return root, content
