"""Functions of a DAVE-ML file: gridded and ungridded tables over breakpoints, and how far each argument goes."""

import itertools
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.daveml.xml_reader import Node
from abhv_mc.io.input_error import one_of

_EXTRAPOLATE = ("neither", "min", "max", "both")


@dataclass(frozen=True)
class Argument:
    """One independent variable of a look-up."""

    variable: str  # varID
    low: float | None  # it is held within, where it is not extrapolated
    high: float | None
    extrapolate: str  # beyond which end: neither, min, max or both


@dataclass(frozen=True)
class Grid:
    """Breakpoints of one axis: their identifier, and the numbers that rise."""

    name: str
    points: Floats


@dataclass(frozen=True)
class TableData:
    """Values ``[axis_0, axis_1, ...]`` on grids; scattered, ``points`` [point, axis] and values [point]."""

    name: str
    grids: tuple[Grid, ...]
    points: Floats | None
    values: Floats
    description: str


@dataclass(frozen=True)
class LookUp:
    """The function that gives one variable."""

    name: str
    description: str
    arguments: tuple[Argument, ...]
    table: TableData
    line: int


def read_look_ups(root: Node) -> dict[str, LookUp]:
    """Every function by the variable that it gives (varID). Raises InputError."""
    reader = _Tables(root)
    found: dict[str, LookUp] = {}
    for node in root.all("function"):
        given, look_up = reader.read_function(node)
        if given in found:
            raise node.refuse(f"a second function of '{given}'", "one")
        found[given] = look_up
    return found


class _Tables:
    def __init__(self, root: Node) -> None:
        self._grids: dict[str, Grid] = {}
        for node in root.all("breakpointDef"):
            name = node.attributes.get("bpID", "")
            points = _numbers(node.first("bpVals") or node)
            self._grids[name] = Grid(name, _rising(node, points))
        self._definitions: dict[str, Node] = {}
        for node in _descendants(root):
            key = node.attributes.get("gtID") or node.attributes.get("utID") or node.attributes.get("utId")
            if key and node.name in ("griddedTableDef", "ungriddedTableDef", "griddedTable", "ungriddedTable"):
                self._definitions[key] = node

    def read_function(self, node: Node) -> tuple[str, LookUp]:
        name = node.attributes.get("name", "function")
        arguments, table = self._read_points(node, name) if node.first("dependentVarPts") else self._read_refs(node)
        given = node.first("dependentVarPts") or node.first("dependentVarRef")
        if given is None or "varID" not in given.attributes:
            raise node.refuse(f"the function '{name}' of nothing", "dependentVarRef with its varID")
        axes = len(table.grids) if table.points is None else table.points.shape[1]
        if len(arguments) != axes:
            raise node.refuse(f"{len(arguments)} arguments of a table of {axes} axes", "as many")
        return given.attributes["varID"], LookUp(name, node.words("description"), arguments, table, node.line)

    def _read_refs(self, node: Node) -> tuple[tuple[Argument, ...], TableData]:
        definition = node.first("functionDefn")
        if definition is None:
            raise node.refuse("a function without a definition", "functionDefn, or points")
        kinds = ("griddedTableDef", "griddedTable", "ungriddedTableDef", "ungriddedTable")
        tables = definition.all(*kinds)
        for reference in definition.all("griddedTableRef", "ungriddedTableRef"):
            attributes = reference.attributes
            key = attributes.get("gtID") or attributes.get("utID") or attributes.get("utId") or ""
            if key not in self._definitions:
                raise reference.refuse(f"the table '{key}'", one_of(self._definitions, key))
            tables.append(self._definitions[key])
        if len(tables) != 1:
            raise definition.refuse(f"{len(tables)} tables", "one gridded or ungridded table")
        arguments = tuple(self._argument(reference) for reference in node.all("independentVarRef"))
        gridded = tables[0].name in kinds[:2]
        return arguments, self._gridded(tables[0]) if gridded else self._ungridded(tables[0], len(arguments))

    def _read_points(self, node: Node, name: str) -> tuple[tuple[Argument, ...], TableData]:
        """A function that holds its points itself."""
        parts = node.all("independentVarPts")
        grids = tuple(Grid(part.attributes.get("varID", ""), _rising(part, _numbers(part))) for part in parts)
        values = node.first("dependentVarPts") or node
        shaped = _shaped(values, _numbers(values), grids)
        return tuple(self._argument(part) for part in parts), TableData(name, grids, None, shaped, "")

    def _argument(self, node: Node) -> Argument:
        attributes = node.attributes
        extrapolate = attributes.get("extrapolate", "neither")
        if extrapolate not in _EXTRAPOLATE:
            raise node.refuse(f"extrapolate '{extrapolate}'", one_of(_EXTRAPOLATE, extrapolate))
        if attributes.get("interpolate", "linear") != "linear":
            raise node.refuse(f"interpolation '{attributes['interpolate']}'", "'linear'")
        ends = []
        for key in ("min", "max"):
            ends.append(node.number(attributes[key]) if key in attributes else None)
        return Argument(attributes.get("varID", ""), ends[0], ends[1], extrapolate)

    def _gridded(self, node: Node) -> TableData:
        references = [part.attributes.get("bpID", "") for part in (node.first("breakpointRefs") or node).all("bpRef")]
        for key in references:
            if key not in self._grids:
                raise node.refuse(f"the breakpoints '{key}'", one_of(self._grids, key))
        grids = tuple(self._grids[key] for key in references)
        data = node.first("dataTable") or node
        name = node.attributes.get("name") or node.attributes.get("gtID") or "table"
        return TableData(name, grids, None, _shaped(data, _numbers(data), grids), node.words("description"))

    def _ungridded(self, node: Node, axes: int) -> TableData:
        """Scattered points; points that fill a grid are a table like any other."""
        rows = [_numbers(point) for point in node.all("dataPoint")]
        if len(rows) < 2 or any(row.size != axes + 1 for row in rows):
            raise node.refuse("an ungridded table", f"points of {axes} coordinates and a value each")
        array = np.array(rows)
        points, values = array[:, :-1], array[:, -1]
        name = node.attributes.get("name") or node.attributes.get("utID") or "table"
        axis_points = [np.unique(column) for column in points.T]
        order = np.lexsort(points.T[::-1])
        if len(rows) == np.prod([axis.size for axis in axis_points]) and np.array_equal(
            points[order], np.array(list(itertools.product(*axis_points)))
        ):
            grids = tuple(Grid(f"{name}_{i}", axis) for i, axis in enumerate(axis_points))
            shape = [axis.size for axis in axis_points]
            return TableData(name, grids, None, values[order].reshape(shape), node.words("description"))
        if len(np.unique(points, axis=0)) != len(points):
            raise node.refuse("a point twice", "each point once")
        return TableData(name, (), points, values, node.words("description"))


def _numbers(node: Node) -> Floats:
    return np.array([node.number(word) for word in node.text.replace(",", " ").replace(";", " ").split()])


def _rising(node: Node, points: Floats) -> Floats:
    if points.size < 2 or not (np.diff(points) > 0.0).all():
        raise node.refuse("breakpoints that do not rise", "at least two numbers that rise")
    return points


def _shaped(node: Node, values: Floats, grids: tuple[Grid, ...]) -> Floats:
    shape = [grid.points.size for grid in grids]
    if not grids or values.size != np.prod(shape):
        expected = f"{' x '.join(map(str, shape))}, as its breakpoints" if grids else "breakpoints"
        raise node.refuse(f"a table of {values.size} values", expected)
    return values.reshape(shape)


def _descendants(node: Node) -> list[Node]:
    found = []
    for child in node.children:
        found += [child, *_descendants(child)]
    return found
