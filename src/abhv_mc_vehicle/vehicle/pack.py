"""Conversion of vehicle tables to the arrays of :mod:`abhv_mc_vehicle.kernel.plant.vehicle`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Ints
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
    return Table((), np.asarray(value, dtype=np.float64))


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
    constants: dict[float, int] = {}
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
    lengths = np.array([axis.grid.size for axis in axes.values()], dtype=np.int64)

    n_groups = len(members)
    dimensions, start, width, used, first_row = (
        np.zeros(n_groups, dtype=np.int64) for _ in range(5)
    )
    group_axis, stride = (np.zeros((n_groups, MAX_DIMENSIONS), dtype=np.int64) for _ in range(2))
    rows = np.zeros(len(everything), dtype=np.int64)
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
        axis_variable=np.array([axis.variable for axis in axes.values()], dtype=np.int64),
        axis_start=np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64),
        axis_length=lengths,
        grid=np.concatenate([axis.grid for axis in axes.values()]),
        inverse_step=np.concatenate(
            [np.append(1.0 / np.diff(axis.grid), 0.0) for axis in axes.values()]
        ),
        group_dimensions=dimensions,
        group_axis=group_axis,
        group_stride=stride,
        group_start=start,
        group_width=width,
        group_used=used,
        group_row=first_row,
        data=np.concatenate(blocks),
        fixed_row=np.array([rows[entry_of[name]] for name in FIXED_TABLE_ROWS], dtype=np.int64),
        n_rows=int(width.sum()),
    )
    return packed, rows[: len(tables)]


def valid_range(vehicle: Vehicle, variable: str) -> tuple[float, float]:
    """Return the range of a variable that its tables cover, within the vehicle's limits.

    The range is infinite if no table depends on the variable and it has no limit.
    """
    tables, envelope = vehicle.tables, vehicle.constants.envelope._asdict()
    low, high = (
        envelope.get(f"{variable}_{end}", limit)
        for end, limit in (("min", -np.inf), ("max", np.inf))
    )
    for axis in np.flatnonzero(tables.axis_variable == VARIABLES.index(variable)):
        grid = tables.grid[tables.axis_start[axis] :][: tables.axis_length[axis]]
        low, high = max(low, float(grid[0])), min(high, float(grid[-1]))
    return low, high


def nodes_of(tables: Tables, variable: str) -> Floats:
    """Return the nodes of all tables over a variable, in ascending order."""
    axes = np.flatnonzero(tables.axis_variable == VARIABLES.index(variable))
    grids = [tables.grid[tables.axis_start[axis] :][: tables.axis_length[axis]] for axis in axes]
    return np.unique(np.concatenate([np.zeros(0), *grids]))
