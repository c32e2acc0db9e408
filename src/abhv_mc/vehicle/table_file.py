"""Read a table of a complete grid: a row per point with its axes and a value, in any order, or a matrix.

A header names the variable and its unit (``mach,alpha_deg,value``); a vehicle file may say it instead.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.io.foreign_table import ForeignTable, read_foreign_table, read_head, split_head
from abhv_mc.io.input_error import Refusal, one_of
from abhv_mc.io.units import ANGLE, LENGTH, MASS, parse_unit
from abhv_mc.kernel.plant.vehicle import MAX_DIMENSIONS, VARIABLES
from abhv_mc.vehicle.pack import Axis, Table

VALUE, IGNORE = "value", "ignore"

ALIASES = {
    "alpha": "angle_of_attack",
    "beta": "sideslip",
    "eta": "equivalence_ratio",
    "phi": "equivalence_ratio",
    "throttle": "equivalence_ratio",
}
_ANGLES = ("angle_of_attack", "sideslip", "aileron", "rudder", "elevator")
_DIMENSIONS = {"altitude": LENGTH, "mass": MASS} | dict.fromkeys(_ANGLES, ANGLE)
_PLAIN = ("mach", "equivalence_ratio")
# Wider than any vehicle: what lies outside is a mistaken unit or column. SI and radians.
_PLAUSIBLE = {
    "mach": (0.0, 50.0),
    "equivalence_ratio": (0.0, 20.0),
    "altitude": (-1e3, 2e5),
    "mass": (1e-3, 1e7),
    "angle": (-math.pi, math.pi),
}
_NARROWEST = {
    "deg": 1.0,
    "m": 200.0,
}  # an axis over less holds radians, kilometres, unless the vehicle file says so


@dataclass(frozen=True)
class Role:
    """What a column is: a variable or effector with its unit, the values, or nothing of ours."""

    name: str
    unit: str | None = None


def parse_role(text: str, effectors: Sequence[str] = ()) -> Role:
    """The role of a column from words such as ``angle_of_attack deg``, ``mach``, ``value``. Raises Refusal."""
    name, _, unit = text.strip().partition(" ")
    name = ALIASES.get(name, name)
    known = (*_PLAIN, *_DIMENSIONS, *effectors)
    if name in (VALUE, IGNORE) and not unit:
        return Role(name)
    if name not in known:
        raise Refusal(
            f"'{text}'", f"{one_of((*known, VALUE, IGNORE), name)}, with a unit where it has one"
        )
    return Role(name, unit.strip() or None)


def _find_role(
    rows: ForeignTable, column: int, columns: Mapping[str, Role], effectors: Sequence[str]
) -> Role:
    """Return the role that the vehicle file or its own head gives a column. Raise InputError without one."""
    head = rows.heads[column]
    name, unit = read_head(head, (*_PLAIN, *_DIMENSIONS, *ALIASES, *effectors, VALUE))
    unit = unit or split_head(head)[1] or rows.units[column]
    role = columns.get(head) or columns.get(split_head(head)[0])
    if role is None:
        if not name or (name == VALUE and unit):
            expected = "mach, alpha_deg, value, ... (or its meaning under columns, and the unit of values, in the "
            raise rows.error(None, column, f"the column '{head}'", f"{expected}vehicle file)")
        return Role(ALIASES.get(name, name), unit or None)
    if role.unit is None and role.name not in (VALUE, IGNORE, *_PLAIN):
        suffix = head.rpartition("_")[2]
        return Role(role.name, unit or (suffix if suffix in ("deg", "rad") else None))
    return role


def _unit_factor(rows: ForeignTable, column: int, role: Role) -> float:
    """Factor to SI of an axis, whose unit the header or the vehicle file gives."""
    dimension, unit = (
        _DIMENSIONS.get(role.name) or (None if role.name in _PLAIN else ANGLE),
        role.unit,
    )
    expected = f"{role.name} " + (
        f"in units of {dimension.name}, such as {dimension.unit}" if dimension else "alone"
    )
    if (unit is None) != (dimension is None):
        found = f"'{rows.heads[column]}' " + ("without a unit" if unit is None else f"in '{unit}'")
        raise rows.error(None, column, found, expected)
    if unit is None or dimension is None:
        return 1.0
    try:
        factor, exponents = parse_unit(unit)
    except Refusal as refusal:
        raise rows.error(None, column, refusal.found, expected) from None
    if exponents != dimension.exponents:
        raise rows.error(None, column, f"'{rows.heads[column]}' in '{unit}'", expected)
    return factor


def _check_plausible(
    rows: ForeignTable, column: int, role: Role, numbers: Floats, factor: float, said: bool
) -> None:
    low, high = _PLAUSIBLE[role.name if role.name in _PLAUSIBLE else "angle"]
    outside = np.flatnonzero((numbers * factor < low) | (numbers * factor > high * (1.0 + 1e-12)))
    if outside.size:
        row = int(outside[0])
        expected = (
            f"{low / factor:.6g} to {high / factor:.6g}: is it in another unit than "
            f"'{rows.heads[column]}' says?"
        )
        raise rows.error(row, column, f"{role.name} {numbers[row]:g}", expected)
    if not said and np.ptp(numbers) < _NARROWEST.get(role.unit or "", 0.0):
        found = f"{role.name} over {np.ptp(numbers):g} {role.unit} only"
        expected = f"{role.unit} (if it is, say '{rows.heads[column]}: {role.name} {role.unit}' under columns)"
        raise rows.error(0, column, found, expected)


def _grid(rows: ForeignTable, columns: Sequence[int], points: Floats, order: Ints) -> list[Floats]:
    """Return the grids of the axes from sorted ``points[row, axis]``; ``order`` holds their rows in the file.

    Raise InputError unless the grid is complete.
    """
    names = [rows.heads[column] for column in columns]
    for row in np.flatnonzero((points[1:] == points[:-1]).all(axis=1))[:1] + 1:
        again = int(max(order[row - 1 : row + 1]))
        raise rows.error(again, None, "the same point a second time", "each point once")
    grids = [np.unique(points[:, axis]) for axis in range(len(columns))]
    for column, grid in zip(columns, grids, strict=True):
        if grid.size < 2:
            raise rows.error(
                0, column, f"one value of {rows.heads[column]}", "an axis of at least two"
            )
    for row, point in enumerate(itertools.product(*grids)):
        if row == len(points) or tuple(points[row]) != point:
            words = ", ".join(f"{name} {x:g}" for name, x in zip(names, point, strict=True))
            found = f"a hole in the grid before here: no row for {words}"
            at = int(order[min(row, len(points) - 1)])
            raise rows.error(at, None, found, "every combination of the axes")
    return grids


def read_table(path: Path, columns: Mapping[str, Role], effectors: Sequence[str] = ()) -> Table:
    """Read one table; axes in SI and radians, values as they stand. Raises :class:`InputError` with its place."""
    rows = read_foreign_table(path)
    heads = {name for head in rows.heads for name in (head, split_head(head)[0])}
    for name in columns:
        if name not in heads:
            found = f"no column '{name}', which the vehicle file describes"
            raise rows.error(None, None, found, one_of(rows.heads))
    roles: dict[str, tuple[int, Role]] = {}
    for i in range(len(rows.heads)):
        role = _find_role(rows, i, columns, effectors)
        if role.name == IGNORE:
            continue
        if role.name in roles:
            raise rows.error(None, i, f"a second column of {role.name}", "one")
        roles[role.name] = (i, role)
    if VALUE not in roles:
        raise rows.error(None, None, "no column 'value'", "one (or say which it is under columns)")
    value = roles.pop(VALUE)[0]
    if not 1 <= len(roles) <= MAX_DIMENSIONS:
        raise rows.error(None, None, f"{len(roles)} axes", f"1 to {MAX_DIMENSIONS}")
    factors = [_unit_factor(rows, i, role) for i, role in roles.values()]
    places = [i for i, _ in roles.values()]
    values, *points = rows.numbers([value, *places]).T
    for (i, role), numbers, factor in zip(roles.values(), points, factors, strict=True):
        said = rows.heads[i] in columns and columns[rows.heads[i]].unit is not None
        _check_plausible(rows, i, role, numbers, factor, said)
    order = np.lexsort(points[::-1])
    grids = _grid(rows, places, np.stack(points, axis=1)[order], order)
    axes = tuple(
        Axis(VARIABLES.index(_variable(name, effectors)), grid * factor)
        for name, grid, factor in zip(roles, grids, factors, strict=True)
    )
    return Table(axes, values[order].reshape([grid.size for grid in grids]))


def _variable(name: str, effectors: Sequence[str]) -> str:
    return f"effector_{effectors.index(name)}" if name in effectors else name
