"""Table look-up and coefficient build-up with numpy, outside compiled code.

The functions ``evaluate_tables`` and ``table_rows`` sum over the corners of a cell in different
orders. Both are needed to reproduce the last digits of results: trims depend on the order in
``evaluate_tables``, and controller designs depend on the order in ``table_rows``.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from abhv_mc.array_types import Floats, Numbers
from abhv_mc_vehicle.kernel.plant.vehicle import (
    COEFFICIENTS,
    FIXED_TABLE_ROWS,
    VARIABLES,
    Tables,
    Vehicle,
)
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_functions

_AXIS_DEFLECTIONS = [VARIABLES.index(name) for name in ("aileron", "rudder", "elevator")]
_FIRST_EFFECTOR = VARIABLES.index("effector_0")


def make_variables(vehicle: Vehicle, **values: ArrayLike) -> Numbers:
    """Return variables [variable, point] from named values (SI, radians).

    Variables without a value are zero; effector deflections follow from the axis deflections.
    """
    arrays = [np.asarray(value) for value in values.values()]
    shape = np.broadcast_shapes((1,), *(array.shape for array in arrays))
    variables = np.zeros((len(VARIABLES), *shape), dtype=np.result_type(np.float64, *arrays))
    variables[0] = 1.0
    for name, array in zip(values, arrays, strict=True):
        variables[VARIABLES.index(name)] = array
    mixed = np.tensordot(vehicle.effector_mix, variables[_AXIS_DEFLECTIONS], axes=1)
    variables[_FIRST_EFFECTOR : _FIRST_EFFECTOR + len(mixed)] = mixed
    return variables


def evaluate_tables(tables: Tables, variables: Floats) -> Floats:
    """Interpolate all tables [row, point] at variables [variable, point].

    Values are constant beyond the edges of the tables.
    """
    rows = np.empty((tables.n_rows, *variables.shape[1:]))
    for g in range(tables.group_start.size):
        corners = [
            (np.ones(variables.shape[1:]), np.full(variables.shape[1:], tables.group_start[g]))
        ]
        for axis, stride in zip(tables.group_axis[g], tables.group_stride[g], strict=True):
            if stride == 0:
                continue
            first, length = tables.axis_start[axis], tables.axis_length[axis]
            grid = tables.grid[first : first + length]
            x = np.clip(variables[tables.axis_variable[axis]], grid[0], grid[-1])
            cell = np.clip(np.searchsorted(grid, x, side="right") - 1, 0, length - 2)
            upper = (x - grid[cell]) / (grid[cell + 1] - grid[cell])
            corners = [
                (weight * share, node + (cell + side) * stride)
                for weight, node in corners
                for side, share in ((0, 1.0 - upper), (1, upper))
            ]
        first_row, width = tables.group_row[g], tables.group_width[g]
        within = np.arange(width).reshape(-1, *[1] * (variables.ndim - 1))
        rows[first_row : first_row + width] = sum(
            weight * tables.data[node + within] for weight, node in corners
        )
    return rows


def table_rows(tables: Tables, variables: Numbers) -> Numbers:
    """Interpolate all tables at variables that may be complex.

    A complex step gives the exact derivative within a table cell.
    """
    low, weight = [], []
    for variable, start, length in zip(
        tables.axis_variable, tables.axis_start, tables.axis_length, strict=True
    ):
        grid, x = tables.grid[start : start + length], variables[variable]
        x = x if np.imag(x).any() else x.real
        cell = np.clip(np.searchsorted(grid, x.real, side="right") - 1, 0, length - 2)
        fraction = (x - grid[cell]) / (grid[cell + 1] - grid[cell])
        fraction = np.where(fraction.real < 0.0, 0.0, np.where(fraction.real > 1.0, 1.0, fraction))
        low.append(cell)
        weight.append(fraction)
    shape = variables.shape[1:]
    rows = np.zeros((tables.n_rows, *shape), dtype=np.result_type(*weight, np.float64))
    for group, width in enumerate(tables.group_width):
        axes, strides = tables.group_axis[group], tables.group_stride[group]
        used = [d for d in range(len(strides)) if strides[d]]
        node = np.full(shape, tables.group_start[group], dtype=np.int64)
        for d in used:
            node = node + low[axes[d]] * strides[d]
        column = np.arange(width).reshape((-1,) + (1,) * len(shape))
        value: Any = 0.0
        for corner in range(2 ** len(used)):
            share: Any = 1.0
            offset = 0
            for bit, d in enumerate(used):
                upper = corner >> bit & 1
                share = share * (weight[axes[d]] if upper else 1.0 - weight[axes[d]])
                offset += int(strides[d]) * upper
            value = value + share * tables.data[column + node + offset]
        row = int(tables.group_row[group])
        rows[row : row + width] = value
    return rows


def evaluate_coefficients(
    vehicle: Vehicle, variables: Numbers, factors: Floats | None = None, rows: Numbers | None = None
) -> Numbers:
    """Return the six COEFFICIENTS [coefficient, point] at variables [variable, point].

    ``factors`` [parameter] or [parameter, point] multiply the table terms; None means all 1.
    ``rows`` contains the interpolated tables if they have already been computed.
    """
    if vehicle.foreign.aerodynamics:
        return evaluate_functions(vehicle, variables)[0]
    rows = evaluate_tables(vehicle.tables, variables) if rows is None else rows
    coefficients = np.zeros(
        (len(COEFFICIENTS), *variables.shape[1:]), dtype=np.result_type(rows, variables)
    )
    for coefficient, row, variable, factor in zip(*vehicle.build_up, strict=True):
        term = rows[row] * variables[variable]
        coefficients[coefficient] += term if factors is None else factors[factor] * term
    return coefficients


def evaluate_fixed(
    vehicle: Vehicle, variables: Numbers, rows: Numbers | None = None
) -> dict[str, Numbers]:
    """Return propulsion and mass quantities [point] by their names in FIXED_TABLE_ROWS."""
    rows = evaluate_tables(vehicle.tables, variables) if rows is None else rows
    return {
        name: rows[row]
        for name, row in zip(FIXED_TABLE_ROWS, vehicle.tables.fixed_row, strict=True)
    }
