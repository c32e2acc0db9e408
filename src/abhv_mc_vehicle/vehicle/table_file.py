"""Reading of tables on a complete grid, and conversion to arrays for the compiled plant.

A table has one row per point, or is a matrix.
Column headers state variables and units (``mach,alpha_deg,value``), unless the vehicle file states
them.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.io.foreign_table import ForeignTable, read_foreign_table, read_head, split_head
from abhv_mc.io.messages import Refusal, counted, one_of
from abhv_mc.io.units import ANGLE, LENGTH, MASS, parse_unit
from abhv_mc_vehicle.kernel.plant.vehicle import (
    CHUNK,
    FIXED_TABLE_ROWS,
    MAX_DIMENSIONS,
    VARIABLES,
    Tables,
    Vehicle,
)

# Values of missing tables: 0, or 1 for the specific impulse, which is a divisor.
_ABSENT = {name: 1.0 if name == "specific_impulse" else 0.0 for name in FIXED_TABLE_ROWS}


@dataclass(frozen=True)
class Axis:
    """Axis of a table."""

    variable: int  # index of the variable in VARIABLES
    grid: Floats  # [node] at least two strictly increasing values, in SI units and radians


@dataclass(frozen=True)
class Table:
    """Table over one to three axes, or a constant without axes."""

    axes: tuple[Axis, ...]
    values: Floats  # [node of axis 0, node of axis 1, ...]

    def ordered(self) -> "Table":
        """Return the table with its axes in the order of VARIABLES.

        Tables with equal axes can then form one group.
        """
        order = sorted(range(len(self.axes)), key=lambda d: self.axes[d].variable)
        return Table(tuple(self.axes[d] for d in order), np.transpose(self.values, order))

    def scaled(self, factor: float) -> "Table":
        """Return the table with all values multiplied by a factor."""
        return Table(self.axes, self.values * factor)


def make_constant(value: float) -> Table:
    """Return a table with one constant value."""
    return Table((), np.asarray(value, np.float64))


def _key(table: Table) -> tuple[tuple[int, bytes], ...]:
    return tuple((axis.variable, axis.grid.tobytes()) for axis in table.axes)


def pack_tables(tables: Sequence[Table], fixed: Mapping[str, int]) -> tuple[Tables, Ints]:
    """Pack tables into groups with equal axes, and return the row of each entry.

    The values of a group's tables at a node are contiguous. ``fixed`` maps FIXED_TABLE_ROWS to
    entries; missing tables become constants. Constants join the first one-dimensional group, so
    that they need no separate look-up.
    """
    everything = [table.ordered() for table in tables]
    entry_of = dict(fixed)
    constants = {}
    for name in FIXED_TABLE_ROWS:
        if name not in entry_of:
            value = _ABSENT[name]
            if value not in constants:
                constants[value] = len(everything)
                everything.append(make_constant(value))
            entry_of[name] = constants[value]
    carrier = next(
        (table.axes for table in everything if len(table.axes) == 1),
        (Axis(VARIABLES.index("one"), np.array([0.0, 2.0])),),
    )
    spread = np.ones([axis.grid.size for axis in carrier])
    everything = [
        table if table.axes else Table(carrier, spread * table.values) for table in everything
    ]

    members: dict[tuple[tuple[int, bytes], ...], list[int]] = {}
    for entry, table in enumerate(everything):
        members.setdefault(_key(table), []).append(entry)
    axes = {
        key: axis for table in everything for key, axis in zip(_key(table), table.axes, strict=True)
    }
    axis_number = {axis_key: i for i, axis_key in enumerate(axes)}
    grids = [axis.grid for axis in axes.values()]
    lengths = np.array([grid.size for grid in grids], np.int64)

    n_groups = len(members)
    dimensions, start, width, used, first_row = (np.zeros(n_groups, np.int64) for _ in range(5))
    group_axis, stride = (np.zeros((n_groups, MAX_DIMENSIONS), np.int64) for _ in range(2))
    rows = np.zeros(len(everything), np.int64)
    blocks: list[Floats] = []
    for g, (group_key, entries) in enumerate(members.items()):
        dimensions[g] = max(2, len(group_key))
        used[g] = len(entries)
        width[g] = -(-len(entries) // CHUNK) * CHUNK
        block = np.zeros((*everything[entries[0]].values.shape, width[g]))
        block[..., : len(entries)] = np.stack(
            [everything[entry].values for entry in entries], axis=-1
        )
        first_row[g] = width[:g].sum()
        start[g] = sum(earlier.size for earlier in blocks)
        for d, axis_key in enumerate(group_key):
            group_axis[g, d] = axis_number[axis_key]
            stride[g, d] = int(np.prod(block.shape[d + 1 :]))
        rows[entries] = first_row[g] + np.arange(len(entries))
        blocks.append(block.ravel())

    packed = Tables(
        axis_variable=np.array([axis.variable for axis in axes.values()], np.int64),
        axis_start=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
        axis_length=lengths,
        grid=np.concatenate(grids),
        inverse_step=np.concatenate([np.append(1.0 / np.diff(grid), 0.0) for grid in grids]),
        group_dimensions=dimensions,
        group_axis=group_axis,
        group_stride=stride,
        group_start=start,
        group_width=width,
        group_used=used,
        group_row=first_row,
        data=np.concatenate(blocks),
        fixed_row=np.array([rows[entry_of[name]] for name in FIXED_TABLE_ROWS], np.int64),
        n_rows=int(width.sum()),
    )
    return packed, rows[: len(tables)]


def valid_range(vehicle: Vehicle, variable: str) -> tuple[float, float]:
    """Return the range of a variable that its tables cover, within the vehicle's limits.

    The range is infinite if no table depends on the variable and it has no limit.
    """
    tables = vehicle.tables
    envelope = vehicle.constants.envelope._asdict()
    low, high = (
        envelope.get(f"{variable}_{end}", limit)
        for end, limit in (("min", -np.inf), ("max", np.inf))
    )
    for axis in np.flatnonzero(tables.axis_variable == VARIABLES.index(variable)):
        grid = tables.grid[tables.axis_start[axis] :][: tables.axis_length[axis]]
        low = max(low, float(grid[0]))
        high = min(high, float(grid[-1]))
    return low, high


def nodes_of(tables: Tables, variable: str) -> Floats:
    """Return the nodes of all tables over a variable, in ascending order."""
    axes = np.flatnonzero(tables.axis_variable == VARIABLES.index(variable))
    grids = [tables.grid[tables.axis_start[axis] :][: tables.axis_length[axis]] for axis in axes]
    return np.unique(np.concatenate([np.zeros(0), *grids]))


VALUE = "value"
IGNORE = "ignore"

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
# Plausible ranges in SI units and radians; values outside a range indicate a wrong unit or column.
_PLAUSIBLE = {
    "mach": (0.0, 50.0),
    "equivalence_ratio": (0.0, 20.0),
    "altitude": (-1e3, 2e5),
    "mass": (1e-3, 1e7),
    "angle": (-math.pi, math.pi),
}
# Axes with a smaller range are probably in radians or kilometres, if no unit is stated.
_NARROWEST = {"deg": 1.0, "m": 200.0}


@dataclass(frozen=True)
class Role:
    """Role of a column: an axis with its unit, the table values, or an ignored column."""

    name: str
    unit: str | None = None


def parse_role(text: str, effectors: Sequence[str]) -> Role:
    """Parse the role of a column, such as ``angle_of_attack deg``, ``mach`` or ``value``.

    Raise Refusal if the role is unknown.
    """
    name, _, unit = text.strip().partition(" ")
    name = ALIASES.get(name, name)
    names = (*_PLAIN, *_DIMENSIONS, *effectors)
    if name in (VALUE, IGNORE) and not unit:
        return Role(name)
    if name not in names:
        raise Refusal(
            f"unknown meaning '{text}' of a column",
            f"{one_of((*names, VALUE, IGNORE), name)}, with a unit if the variable has one",
        )
    return Role(name, unit.strip() or None)


def _find_role(
    rows: ForeignTable, column: int, columns: Mapping[str, Role], effectors: Sequence[str]
) -> Role:
    """Return a column's role from the vehicle file or header. Raise InputError if unknown."""
    head = rows.heads[column]
    name, unit = read_head(head, (*_PLAIN, *_DIMENSIONS, *ALIASES, *effectors, VALUE))
    unit = unit or split_head(head)[1] or rows.units[column]
    role = columns.get(head) or columns.get(split_head(head)[0])
    if role is None:
        if not name or (name == VALUE and unit):
            expected = (
                "a header such as mach, alpha_deg or value (or the column's meaning under "
                "'columns', and the unit of the values under 'unit', in the "
            )
            raise rows.error(
                None, column, f"the header '{head}' is not recognized", f"{expected}vehicle file)"
            )
        return Role(ALIASES.get(name, name), unit or None)
    if role.unit is None and role.name not in (VALUE, IGNORE, *_PLAIN):
        suffix = head.rpartition("_")[2]
        return Role(role.name, unit or (suffix if suffix in ("deg", "rad") else None))
    return role


def _unit_factor(rows: ForeignTable, column: int, role: Role) -> float:
    """Return the factor that converts an axis to SI; the column's role contains the unit."""
    dimension = _DIMENSIONS.get(role.name) or (None if role.name in _PLAIN else ANGLE)
    unit = role.unit
    expected = f"{role.name} " + (
        f"in units of {dimension.name}, such as {dimension.unit}" if dimension else "without a unit"
    )
    if (unit is None) != (dimension is None):
        problem = f"'{rows.heads[column]}' " + (
            "has no unit" if unit is None else f"has the unit '{unit}'"
        )
        raise rows.error(None, column, problem, expected)
    if unit is None or dimension is None:
        return 1.0
    try:
        factor, exponents = parse_unit(unit)
    except Refusal as refusal:
        raise rows.error(None, column, refusal.found, expected) from None
    if exponents != dimension.exponents:
        raise rows.error(None, column, f"'{rows.heads[column]}' has the unit '{unit}'", expected)
    return factor


def _check_plausible(
    rows: ForeignTable,
    column: int,
    role: Role,
    numbers: Floats,
    factor: float,
    has_declared_unit: bool,
) -> None:
    low, high = _PLAUSIBLE[role.name if role.name in _PLAUSIBLE else "angle"]
    outside = np.flatnonzero((numbers * factor < low) | (numbers * factor > high * (1.0 + 1e-12)))
    if outside.size:
        row = int(outside[0])
        raise rows.error(
            row,
            column,
            f"{role.name} is {numbers[row]:g}",
            f"{low / factor:.6g} to {high / factor:.6g}; check the unit in the header "
            f"'{rows.heads[column]}'",
        )
    if not has_declared_unit and np.ptp(numbers) < _NARROWEST.get(role.unit or "", 0.0):
        raise rows.error(
            0,
            column,
            f"{role.name} covers only {np.ptp(numbers):g} {role.unit}",
            f"a wider range in {role.unit} (to confirm the unit, write "
            f"'{rows.heads[column]}: {role.name} {role.unit}' under 'columns')",
        )


def _grid(rows: ForeignTable, columns: Sequence[int], points: Floats, order: Ints) -> list[Floats]:
    """Return the grids of the axes from sorted points [row, axis].

    ``order`` contains the row of each point in the file. Raise InputError if the grid is
    incomplete.
    """
    names = [rows.heads[column] for column in columns]
    for row in np.flatnonzero((points[1:] == points[:-1]).all(axis=1))[:1] + 1:
        repeated_row = int(max(order[row - 1 : row + 1]))
        raise rows.error(repeated_row, None, "the row repeats a point", "each point only once")
    grids = [np.unique(points[:, axis]) for axis in range(len(columns))]
    for column, grid in zip(columns, grids, strict=True):
        if grid.size < 2:
            raise rows.error(
                0,
                column,
                f"{rows.heads[column]} has only one value",
                "an axis with at least two values",
            )
    for row, point in enumerate(itertools.product(*grids)):
        if row == len(points) or tuple(points[row]) != point:
            node = ", ".join(f"{name} {x:g}" for name, x in zip(names, point, strict=True))
            problem = f"the grid has no row for {node}"
            file_row = int(order[min(row, len(points) - 1)])
            raise rows.error(file_row, None, problem, "a row for every combination of axis values")
    return grids


def read_table(
    path: Path, columns: Mapping[str, Role], effectors: Sequence[str] = (), comma: str = ""
) -> Table:
    """Read a table; convert its axes, but not its values, to SI units and radians.

    Raise InputError if the table is invalid.
    """
    rows = read_foreign_table(path, comma=comma)
    heads = {name for head in rows.heads for name in (head, split_head(head)[0])}
    for name in columns:
        if name not in heads:
            raise rows.error(
                None,
                None,
                f"the table has no column '{name}', which the vehicle file describes",
                one_of(rows.heads),
            )
    roles = {}
    for i in range(len(rows.heads)):
        role = _find_role(rows, i, columns, effectors)
        if role.name == IGNORE:
            continue
        if role.name in roles:
            raise rows.error(
                None,
                i,
                f"a second column contains {role.name}",
                "only one column for each variable",
            )
        roles[role.name] = (i, role)
    if VALUE not in roles:
        raise rows.error(
            None,
            None,
            "the column 'value' is missing",
            "a column 'value', or another column with the meaning 'value' under 'columns'",
        )
    value = roles.pop(VALUE)[0]
    if not 1 <= len(roles) <= MAX_DIMENSIONS:
        raise rows.error(
            None,
            None,
            f"the table has {counted(len(roles), 'axis/axes')}",
            f"1 to {MAX_DIMENSIONS}",
        )
    factors = [_unit_factor(rows, i, role) for i, role in roles.values()]
    axis_columns = [i for i, _ in roles.values()]
    values, *points = rows.numbers([value, *axis_columns]).T
    for (i, role), numbers, factor in zip(roles.values(), points, factors, strict=True):
        has_declared_unit = rows.heads[i] in columns and columns[rows.heads[i]].unit is not None
        _check_plausible(rows, i, role, numbers, factor, has_declared_unit)
    order = np.lexsort(points[::-1])
    grids = _grid(rows, axis_columns, np.stack(points, axis=1)[order], order)
    axes = tuple(
        Axis(VARIABLES.index(_variable(name, effectors)), grid * factor)
        for name, grid, factor in zip(roles, grids, factors, strict=True)
    )
    return Table(axes, values[order].reshape([grid.size for grid in grids]))


def _variable(name: str, effectors: Sequence[str]) -> str:
    return f"effector_{effectors.index(name)}" if name in effectors else name
