"""JSBSim's functions and tables as the text of Python expressions, by a fixed list of elements.

Nothing that a file says becomes code: its names become identifiers, its numbers are read and written anew.
"""

import ast
import functools
from collections.abc import Callable, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.input_error import one_of
from abhv_mc.io.xml_reader import Node
from abhv_mc.user_code.module_text import Line, call, free_name, number, sequence

_PROPERTY, _VALUE, _TABLE = ("property", "p"), ("value", "v"), ("table", "t")
_WORDS = ("description", "documentation", "title")
_JOINED = {"sum": "+", "difference": "-", "product": "*", "quotient": "/"}
_FOLDED = {"max": "larger({}, {})", "min": "smaller({}, {})"}
_ONE = {
    **{name: f"{name}({{}})" for name in ("abs", "exp", "sin", "cos", "tan", "asin", "acos", "sqrt", "floor", "ceil")},
    "ln": "log({})",
    "log10": "(log({}) / log(10.0))",
    "log2": "(log({}) / log(2.0))",
    "atan": "atan2({}, 1.0)",
    "toradians": "({} * DEGREE)",
    "todegrees": "({} / DEGREE)",
    "sign": "(-1.0 if {} < 0.0 else 1.0)",
    "integer": "trunc({})",
    "fraction": "({0} - trunc({0}))",
    "not": "(1.0 if {} == 0.0 else 0.0)",
}  # fmt: skip
_TWO = {
    "atan2": "atan2({}, {})",
    "fmod": "fmod({}, {})",
    **{name: f"(1.0 if {{}} {sign} {{}} else 0.0)"
       for name, sign in (("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("nq", "!="))},
}  # fmt: skip
_TRUTHS = {"and": " and ", "or": " or "}
_OPERATORS = (
    *_JOINED, *_FOLDED, *_ONE, *_TWO, *_TRUTHS, "pow", "avg", "ifthen", "pi", "property", "value", "table",
)  # fmt: skip
FROM_MATH = ("ceil", "floor", "fmod", "trunc")
Resolve = Callable[[str, Node], str]


def operand_of(function: Node) -> Node:
    """The one element that gives a function its value. Raises InputError."""
    operands = [child for child in function.children if child.name not in _WORDS]
    if len(operands) != 1:
        raise function.refuse(f"a function of {len(operands)} elements", "one")
    return operands[0]


def property_of(node: Node) -> tuple[str, str]:
    """The sign, empty or ``-``, and the name of a property."""
    name = node.text
    return ("-", name[1:]) if name.startswith("-") else ("", name)


def factors_of(node: Node) -> list[Node]:
    """The factors of a product and of products in it; else the element itself."""
    if node.name != "product":
        return [node]
    return [factor for child in node.children for factor in factors_of(child)]


class Expressions:
    """Elements as text. Tables are collected, each once, as statements of the module."""

    def __init__(self, resolve: Resolve, taken: set[str]) -> None:
        self._resolve, self._taken = resolve, taken
        self._tables: dict[str, str] = {}  # name by text

    @property
    def tables(self) -> list[Line]:
        """The tables that were read."""
        return [Line(f"{name} = {text}") for text, name in self._tables.items()]

    def read(self, node: Node, name: str) -> str:
        """The value of an element, whose tables are named after ``name``. Raises InputError."""
        return self.tidy(node, self.value(node, name))

    @staticmethod
    def tidy(node: Node, text: str) -> str:
        """A text without brackets that it does not need. Raises InputError."""
        try:
            return ast.unparse(ast.parse(text, mode="eval"))
        except (SyntaxError, RecursionError, MemoryError):
            raise node.refuse(
                "a function too deep for Python", "parts of it as functions"
            ) from None

    def value(self, node: Node, name: str) -> str:
        """As :meth:`read`, with more brackets."""
        kind = node.name
        if kind in _PROPERTY:
            sign, used = property_of(node)
            text = self._resolve(used, node)
            return f"({sign}{text})" if sign else text
        if kind in _VALUE:
            return f"({number(node.number(node.text))})"
        if kind in _TABLE:
            return self._table(node, name)
        if kind == "pi":
            return number(np.pi)
        operands = [self.value(child, name) for child in node.children if child.name not in _WORDS]
        count = len(operands)
        if kind in _JOINED and count:
            return f"({f' {_JOINED[kind]} '.join(operands)})"
        if kind == "avg" and count:
            return f"(({' + '.join(operands)}) / {count})"
        if kind in _FOLDED and count:
            return functools.reduce(_FOLDED[kind].format, operands)
        if kind in _TRUTHS and count:
            return f"(1.0 if {_TRUTHS[kind].join(f'{each} != 0.0' for each in operands)} else 0.0)"
        if kind == "ifthen" and count == 3:
            return f"({operands[1]} if {operands[0]} != 0.0 else {operands[2]})"
        if kind == "pow" and count == 2:
            return self._power(*operands)
        patterns = {1: _ONE, 2: _TWO}.get(count, {})
        if kind in patterns:
            return patterns[kind].format(*operands)
        if kind in _OPERATORS:
            raise node.refuse(f"'{kind}' of {count} operands", "as many as it takes")
        raise node.refuse(f"the element '{kind}'", one_of(_OPERATORS, kind))

    @staticmethod
    def _power(base: str, exponent: str) -> str:
        try:
            known = float(ast.literal_eval(exponent))
        except ValueError:
            return f"power({base}, {exponent})"
        whole = abs(known) <= 64 and known == int(known)  # real for a negative base, too
        return f"({base} ** {int(known)})" if whole else f"power({base}, {exponent})"

    def _table(self, node: Node, name: str) -> str:
        by_axis = {}
        for k, variable in enumerate(node.all("independentVar")):
            axis = variable.attributes.get("lookup", ("row", "column", "table")[min(k, 2)])
            sign, used = property_of(variable)
            by_axis[axis] = f"{sign}{self._resolve(used, variable)}"
        grids, values = _read_table(node, len(by_axis))
        axes = ("row", "column", "table")[: len(by_axis)]
        if set(by_axis) != set(axes):
            raise node.refuse(
                f"a table over {', '.join(by_axis) or 'nothing'}", "row, column, table"
            )
        keep = [k for k, grid in enumerate(grids) if len(grid) > 1]
        values = values.squeeze(tuple(k for k in range(len(grids)) if k not in keep))
        if not keep:
            return f"({number(float(values))})"
        for k in keep:
            if not (np.diff(grids[k]) > 0.0).all():
                raise node.refuse("breakpoints that do not rise", "a table by rising breakpoints")
        text = call("table", [*(sequence(grids[k]) for k in keep), sequence(values)])
        if text not in self._tables:
            made = free_name(f"{name}_table", self._taken)
            self._taken.add(made)
            self._tables[text] = made
        return call(self._tables[text], (by_axis[axes[k]] for k in keep))


def _read_table(node: Node, axes: int) -> tuple[list[Floats], Floats]:
    """The grids of rows, columns and tables, as many as there are, and the values over them."""
    blocks = node.all("tableData")
    if axes in (1, 2) and len(blocks) == 1:
        *grids, values = _read_block(blocks[0], axes)
        return grids, values
    if axes != 3 or not blocks:
        raise node.refuse(f"a table of {axes} axes and {len(blocks)} blocks", "1 to 3 axes")
    levels = np.array([block.number(block.attributes.get("breakPoint", "")) for block in blocks])
    read = [_read_block(block, 2) for block in blocks]
    rows = np.unique(np.concatenate([block[0] for block in read]))
    columns = np.unique(np.concatenate([block[1] for block in read]))
    # A block bilinear on its own grid is so on the grid of all, too, and is held outside.
    held = [_on_grid(own, rows, columns) for own in read]
    return [rows, columns, levels], np.stack(held, axis=-1)


def _on_grid(block: Sequence[Floats], rows: Floats, columns: Floats) -> Floats:
    own_rows, own_columns, values = block
    wide = np.array([np.interp(columns, own_columns, row) for row in values])
    return np.array([np.interp(rows, own_rows, column) for column in wide.T]).T


def _read_block(data: Node, axes: int) -> tuple[Floats, ...]:
    lines = [[data.number(cell) for cell in line.split()] for line in data.lines]
    head = lines.pop(0) if axes == 2 and lines else [0.0]
    width = len(head) + 1
    if not lines or any(len(line) != width for line in lines):
        raise data.refuse(
            f"rows of {sorted({len(line) for line in lines})} numbers", f"rows of {width}"
        )
    cells = np.array(lines)
    if axes == 1:
        return cells[:, 0], cells[:, 1]
    return cells[:, 0], np.array(head), cells[:, 1:]
