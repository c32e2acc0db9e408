"""Python made of ``ast`` nodes.

Nothing that a file says becomes code: its names become identifiers, its words comments and docstrings.
"""

import ast
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

WIDTH = 116


class Line(NamedTuple):
    """A statement, and the words about it: one line, printable."""

    statement: Any
    words: str = ""


class Block(NamedTuple):
    """A module, class or function that holds its docstring so far, and the statements that follow."""

    head: Any
    body: Sequence["Line | Block"]


def substitute(expression: ast.expr, values: Mapping[str, ast.expr]) -> Any:
    """The same expression, changed in place, with these in place of the names that stand for them."""
    transformer: Any = ast.NodeTransformer()
    transformer.visit_Name = lambda node: values.get(node.id, node)
    return transformer.visit(expression)


def fill(template: str, /, **values: ast.expr) -> Any:
    """An expression of this program's own words, with these in place of the names that stand for them."""
    return substitute(ast.parse(template, mode="eval").body, values)


def name(text: str) -> ast.expr:
    """A variable."""
    return ast.Name(text, ast.Load())


def member(of: str, text: str) -> ast.expr:
    """A variable's field."""
    return ast.Attribute(name(of), text, ast.Load())


def number(value: float) -> ast.expr:
    """A number; those below zero as Python reads them."""
    return ast.UnaryOp(ast.USub(), ast.Constant(-value)) if repr(value).startswith("-") else ast.Constant(value)


def sequence(values: Any) -> ast.expr:
    """Numbers, however nested, as tuples."""
    return (
        ast.Tuple(list(map(sequence, values)), ast.Load()) if isinstance(values, np.ndarray) else number(float(values))
    )


def call(function: str, /, *arguments: ast.expr, **keywords: ast.expr) -> ast.Call:
    """A call."""
    return ast.Call(name(function), list(arguments), [ast.keyword(key, value) for key, value in keywords.items()])


def assign(to: str, value: ast.expr, words: str = "") -> Line:
    """``to = value``."""
    return Line(ast.Assign([ast.Name(to, ast.Store())], value, lineno=0), words)


def declare(field: str, words: str, value: float | None = None) -> Line:
    """A field of a class of floats."""
    default = None if value is None else number(value)
    return Line(ast.AnnAssign(ast.Name(field, ast.Store()), name("float"), default, simple=1), words)


def define(head: str, docstring: str, body: Sequence[Line | Block]) -> Block:
    """A function or class; ``head`` in this program's own words."""
    node: Any = ast.parse(f"{head}\n    pass").body[0]
    node.body = [ast.Expr(ast.Constant(docstring))]
    return Block(node, body)


def names_in(statements: Iterable[Line | Block]) -> Iterator[str]:
    """Every name that is read."""
    for statement in statements:
        yield from (node.id for node in ast.walk(statement[0]) if isinstance(node, ast.Name))
        if isinstance(statement, Block):
            yield from names_in(statement.body)


def write_python(module: Block) -> str:
    """The text, in lines of at most ``WIDTH`` where that is possible."""
    return "\n".join(_lay_out(module, "")) + "\n"


def _lay_out(block: Block, indent: str) -> list[str]:
    lines = [line for text in ast.unparse(block.head).split("\n") for line in _break(text, indent)]
    inner = "" if isinstance(block.head, ast.Module) else indent + "    "
    before: Any = None
    for statement in block.body:
        if isinstance(statement, Block):
            before = None
            lines += ["", "", *_lay_out(statement, inner)]
            continue
        node, words = statement
        text = ast.unparse(node)
        bare = isinstance(node, ast.Assign) and not isinstance(node.value, ast.Call | ast.Tuple)
        if bare and len(inner + text) > WIDTH:
            text = f"{ast.unparse(node.targets[0])} = ({ast.unparse(node.value)})"
        broken = _break(text, inner)
        if words and not broken[1:] and len(broken[0] + words) + 4 <= WIDTH:
            broken, words = [f"{broken[0]}  # {words}"], ""
        if not inner and (words or type(node) is not before):
            lines.append("")
        lines += textwrap.wrap(words, WIDTH, initial_indent=f"{inner}# ", subsequent_indent=f"{inner}# ")
        lines += broken
        before = type(node)
    return lines


def _break(text: str, indent: str) -> list[str]:
    """A statement on lines of its own; one that is too long is broken within its brackets, which its first opens."""
    if len(indent + text) <= WIDTH:
        return [(indent + text).rstrip()]
    first, last, inner = text.index("(") + 1, text.rindex(")"), indent + "    "
    parts = text[first:last].replace(", (", ",\n(").split("\n")
    fold = textwrap.TextWrapper(
        WIDTH, initial_indent=inner, subsequent_indent=inner, break_long_words=False, break_on_hyphens=False
    )
    return [indent + text[:first], *(line for part in parts for line in fold.wrap(part)), indent + text[last:]]
