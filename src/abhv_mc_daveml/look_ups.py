"""Look-up functions of a DAVE-ML file, with gridded and ungridded tables."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import counted, one_of
from abhv_mc.io.xml_reader import Node

Grids = tuple[tuple[str, Floats], ...]  # name and ascending breakpoints of each axis
_EXTRAPOLATE = ("neither", "min", "max", "both")
_GRIDDED = ("griddedTableDef", "griddedTable")
_UNGRIDDED = ("ungriddedTableDef", "ungriddedTable")


@dataclass(frozen=True)
class Argument:
    """Independent variable of a look-up function."""

    variable: str  # varID of the variable
    low: float | None  # bounds to which the variable is clamped
    high: float | None
    extrapolate: (
        str  # ends of the range at which values are extrapolated: neither, min, max or both
    )


class Table(NamedTuple):
    """Table on grids, or values at scattered points."""

    name: str
    title: str
    grids: Grids
    points: Floats | None  # [point, axis] for scattered points
    values: Floats  # values [axis_0, axis_1, ...] or [point]

    def coordinates(self, axis: int) -> Floats:
        """Return the coordinates of the table values along an axis."""
        return self.grids[axis][1] if self.points is None else self.points[:, axis]


@dataclass(frozen=True)
class LookUp:
    """Look-up function: a table and its arguments."""

    name: str
    title: str
    table: Table
    arguments: tuple[Argument, ...]
    line: int


def read_look_ups(root: Node) -> dict[str, LookUp]:
    """Return the look-up functions by dependent variable (varID).

    Raise InputError if a function is invalid.
    """
    grids = {node.attributes.get("bpID", ""): _rising(node, node.first("bpVals") or node)
             for node in root.all("breakpointDef")}  # fmt: skip
    tables = {
        _key(node): node for node in _descendants(root) if node.name in (*_GRIDDED, *_UNGRIDDED)
    }
    look_ups: dict[str, LookUp] = {}
    for node in root.all("function"):
        dependent = node.first("dependentVarPts") or node.first("dependentVarRef")
        name = node.attributes.get("name", "function")
        if dependent is None or "varID" not in dependent.attributes:
            raise node.refuse(
                f"the function '{name}' has no dependent variable", "dependentVarRef with its varID"
            )
        axes = node.all("independentVarRef", "independentVarPts")
        arguments = tuple(map(_read_argument, axes))
        if dependent.name == "dependentVarPts":  # The function element itself contains the points.
            own = tuple((axis.attributes.get("varID", ""), _rising(axis, axis)) for axis in axes)
            table = Table(name, "", own, None, _shaped(dependent, own))
        else:
            table = _read_table(_find_table(node, tables), grids, len(arguments))
        number = len(table.grids) if table.points is None else table.points.shape[1]
        if len(arguments) != number:
            raise node.refuse(
                f"found {counted(len(arguments), 'argument')} for a table of "
                f"{counted(number, 'axis/axes')}",
                "one argument for each axis",
            )
        variable = dependent.attributes["varID"]
        if variable in look_ups:
            raise node.refuse(
                f"'{variable}' has a second function", "only one function of each variable"
            )
        title = node.words("description") or table.title or name
        look_ups[variable] = LookUp(name, title, table, arguments, node.line)
    return look_ups


def _key(node: Node) -> str:
    attributes = node.attributes
    return attributes.get("gtID") or attributes.get("utID") or attributes.get("utId") or ""


def _read_argument(node: Node) -> Argument:
    attributes = node.attributes
    extrapolate = attributes.get("extrapolate", "neither")
    if extrapolate not in _EXTRAPOLATE:
        raise node.refuse(f"found extrapolate '{extrapolate}'", one_of(_EXTRAPOLATE, extrapolate))
    if attributes.get("interpolate", "linear") != "linear":
        raise node.refuse(f"found interpolation '{attributes['interpolate']}'", "'linear'")
    return Argument(attributes.get("varID", ""), node.bound("min"), node.bound("max"), extrapolate)


def _find_table(node: Node, tables_by_key: Mapping[str, Node]) -> Node:
    definition = node.first("functionDefn") or node
    tables = definition.all(*_GRIDDED, *_UNGRIDDED)
    for reference in definition.all("griddedTableRef", "ungriddedTableRef"):
        if _key(reference) not in tables_by_key:
            raise reference.refuse(
                f"unknown table '{_key(reference)}'", one_of(tables_by_key, _key(reference))
            )
        tables.append(tables_by_key[_key(reference)])
    if len(tables) != 1:
        raise definition.refuse(
            f"found {counted(len(tables), 'table')}", "one gridded or ungridded table"
        )
    return tables[0]


def _read_table(node: Node, grids: Mapping[str, Floats], arguments: int) -> Table:
    """Return a table; scattered points that form a complete grid become a gridded table."""
    name = node.attributes.get("name") or _key(node) or "table"
    title = node.words("description")
    if node.name in _GRIDDED:
        references = (node.first("breakpointRefs") or node).all("bpRef")
        keys = [reference.attributes.get("bpID", "") for reference in references]
        for key in keys:
            if key not in grids:
                raise node.refuse(f"unknown breakpoints '{key}'", one_of(grids, key))
        axes = tuple((key, grids[key]) for key in keys)
        return Table(name, title, axes, None, _shaped(node.first("dataTable") or node, axes))
    rows = [_numbers(point) for point in node.all("dataPoint")]
    if len(rows) < 2 or any(row.size != arguments + 1 for row in rows):
        raise node.refuse(
            "the ungridded table is invalid",
            f"at least two points with {counted(arguments, 'coordinate')} and one value each",
        )
    points, values = np.split(np.array(rows), [-1], axis=1)
    if len(np.unique(points, axis=0)) != len(points):
        raise node.refuse("a point is repeated", "each point only once")
    axes = tuple((f"{name}_{i}", np.unique(column)) for i, column in enumerate(points.T))
    shape = [axis.size for _, axis in axes]
    if len(points) == np.prod(shape):
        return Table(name, title, axes, None, values[np.lexsort(points.T[::-1])].reshape(shape))
    return Table(name, title, (), points, values[:, 0])


def _numbers(node: Node) -> Floats:
    return np.array([node.number(word) for word in re.findall(r"[^\s,;]+", node.text)])


def _rising(node: Node, source: Node) -> Floats:
    points = _numbers(source)
    if points.size < 2 or not (np.diff(points) > 0.0).all():
        raise node.refuse("the breakpoints do not increase", "at least two increasing numbers")
    return points


def _shaped(node: Node, axes: Grids) -> Floats:
    values = _numbers(node)
    shape = [points.size for _, points in axes]
    if not axes or values.size != np.prod(shape):
        expected = f"{' x '.join(map(str, shape))} values, as given by the breakpoints"
        raise node.refuse(
            f"the table has {counted(values.size, 'value')}", expected if axes else "breakpoints"
        )
    return values.reshape(shape)


def _descendants(node: Node) -> Iterator[Node]:
    for child in node.children:
        yield child
        yield from _descendants(child)
