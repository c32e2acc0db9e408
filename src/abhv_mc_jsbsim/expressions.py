"""Translation of JSBSim functions and tables to Python expressions.

Only a fixed list of elements is supported. No text of a file becomes code: names are converted to
identifiers, and numbers are parsed.
"""

from collections.abc import Callable, Sequence

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import counted, joined, one_of, quoted
from abhv_mc.io.xml_reader import Node
from abhv_mc_vehicle.imported_vehicle import Operators, power
from abhv_mc_vehicle.user_code.module_text import Line, call, free_name, number, sequence

_PROPERTY = ("property", "p")
_VALUE = ("value", "v")
_TABLE = ("table", "t")
_WORDS = ("description", "documentation", "title")
_JOINED = {"sum": "+", "difference": "-", "product": "*", "quotient": "/"}
_TRUTHS = {"and": " and ", "or": " or "}
_OPERATORS = Operators(
    between=_JOINED,
    folded={"max": "larger({}, {})", "min": "smaller({}, {})"},
    fixed={
        1: {
            **dict.fromkeys(_JOINED, "{}"),
            **{name: f"{name}({{}})" for name in (
                "abs", "exp", "sin", "cos", "tan", "asin", "acos", "sqrt", "floor", "ceil")},
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
        },
        2: {
            "atan2": "atan2({}, {})",
            "fmod": "fmod({}, {})",
            **{name: f"(1.0 if {{}} {sign} {{}} else 0.0)" for name, sign in (
                ("lt", "<"), ("le", "<="), ("gt", ">"), ("ge", ">="), ("eq", "=="), ("nq", "!="))},
        },
        3: {"ifthen": "({1} if {0} != 0.0 else {2})"},
    },
)  # fmt: skip
_NAMES = (*_OPERATORS.names, *_TRUTHS, "pow", "avg", "pi", "property", "value", "table")
Resolve = Callable[[str, Node], str]


def operand_of(function: Node) -> Node:
    """Return the element that defines a function.

    Raise InputError if there is not exactly one element.
    """
    operands = [child for child in function.children if child.name not in _WORDS]
    if len(operands) != 1:
        raise function.refuse(
            f"the function has {counted(len(operands), 'element')}", "one element"
        )
    return operands[0]


def property_of(node: Node) -> tuple[str, str]:
    """Return the sign ('' or '-') and the name of a property."""
    name = node.text
    return ("-", name[1:]) if name.startswith("-") else ("", name)


def factors_of(node: Node) -> list[Node]:
    """Return the factors of nested products, or the element itself."""
    if node.name != "product":
        return [node]
    return [factor for child in node.children for factor in factors_of(child)]


class Expressions:
    """Translator of elements to Python expressions, which also collects the distinct tables."""

    def __init__(self, resolve: Resolve, reserved: set[str]) -> None:
        self._resolve = resolve
        self._taken = reserved
        self._tables: dict[str, str] = {}  # name of each table, by its text

    @property
    def tables(self) -> list[Line]:
        """Python statements that define the tables."""
        return [Line(f"{name} = {text}") for text, name in self._tables.items()]

    def value(self, node: Node, name: str) -> str:
        """Return the expression of an element; its tables are named after ``name``.

        The expression may have superfluous brackets. Raise InputError if the element is not
        supported.
        """
        kind = node.name
        if kind in _PROPERTY:
            sign, property_name = property_of(node)
            text = self._resolve(property_name, node)
            return f"({sign}{text})" if sign else text
        if kind in _VALUE:
            return f"({number(node.number(node.text))})"
        if kind in _TABLE:
            return self._table(node, name)
        if kind == "pi":
            return number(np.pi)
        operands = [self.value(child, name) for child in node.children if child.name not in _WORDS]
        count = len(operands)
        if kind == "avg" and count:
            return f"(({' + '.join(operands)}) / {count})"
        if kind in _TRUTHS and count:
            condition = _TRUTHS[kind].join(f"{operand} != 0.0" for operand in operands)
            return f"(1.0 if {condition} else 0.0)"
        if kind == "pow" and count == 2:
            return power(*operands)
        if kind not in _NAMES:
            raise node.refuse(f"unknown element '{kind}'", one_of(_NAMES, kind))
        return _OPERATORS.apply(node, kind, operands)

    def _table(self, node: Node, name: str) -> str:
        by_axis = {}
        for k, variable in enumerate(node.all("independentVar")):
            axis = variable.attributes.get("lookup", ("row", "column", "table")[min(k, 2)])
            sign, property_name = property_of(variable)
            by_axis[axis] = f"{sign}{self._resolve(property_name, variable)}"
        grids, values = _read_table(node, len(by_axis))
        axes = ("row", "column", "table")[: len(by_axis)]
        if set(by_axis) != set(axes):
            raise node.refuse(
                f"the table has the axes {quoted(by_axis)}" if by_axis else "the table has no axes",
                f"the axes {quoted(axes)}",
            )
        long_axes = [k for k, grid in enumerate(grids) if len(grid) > 1]
        values = values.squeeze()
        if not long_axes:
            return f"({number(float(values))})"
        for k in long_axes:
            if not (np.diff(grids[k]) > 0.0).all():
                raise node.refuse("the breakpoints are not ascending", "ascending breakpoints")
        text = call("table", [*(sequence(grids[k]) for k in long_axes), sequence(values)])
        if text not in self._tables:
            table_name = free_name(f"{name}_table", self._taken)
            self._taken.add(table_name)
            self._tables[text] = table_name
        return call(self._tables[text], (by_axis[axes[k]] for k in long_axes))


def _read_table(node: Node, axes: int) -> tuple[list[Floats], Floats]:
    """Return the grids of the axes of a table, and the values on the grids."""
    blocks = node.all("tableData")
    if axes in (1, 2) and len(blocks) == 1:
        *grids, values = _read_block(blocks[0], axes)
        return grids, values
    if axes != 3 or not blocks:
        raise node.refuse(
            f"the table has {counted(axes, 'axis/axes')} and {counted(len(blocks), 'block')}",
            "one block for 1 or 2 axes, or at least one block for 3 axes",
        )
    levels = np.array([block.number(block.attributes.get("breakPoint", "")) for block in blocks])
    tables = [_read_block(block, 2) for block in blocks]
    rows = np.unique(np.concatenate([block[0] for block in tables]))
    columns = np.unique(np.concatenate([block[1] for block in tables]))
    # Resampling on the common grid preserves bilinear interpolation.
    resampled = [_on_grid(block, rows, columns) for block in tables]
    return [rows, columns, levels], np.stack(resampled, axis=-1)


def _on_grid(block: Sequence[Floats], rows: Floats, columns: Floats) -> Floats:
    own_rows, own_columns, values = block
    resampled = np.array([np.interp(columns, own_columns, row) for row in values])
    return np.array([np.interp(rows, own_rows, column) for column in resampled.T]).T


def _read_block(data: Node, axes: int) -> tuple[Floats, ...]:
    lines = [[data.number(cell) for cell in line.split()] for line in data.lines]
    head = lines.pop(0) if axes == 2 and lines else [0.0]
    width = len(head) + 1
    if not lines or any(len(line) != width for line in lines):
        *sizes, last = sorted({len(line) for line in lines}) or [0]
        sizes_text = joined([*map(str, sizes), counted(last, "number")], "or")
        raise data.refuse(
            f"the rows have {sizes_text}" if lines else "the table has no rows",
            f"rows of {counted(width, 'number')}",
        )
    cells = np.array(lines)
    if axes == 1:
        return cells[:, 0], cells[:, 1]
    return cells[:, 0], np.array(head), cells[:, 1:]
