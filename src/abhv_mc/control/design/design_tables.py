"""Tables and engine in numpy where a variable may be complex: a complex step gives a cell's exact slope.

Coefficients are built as everywhere, by :mod:`abhv_mc.vehicle.evaluate`. SI, radians.
Complex step: Squire and Trapp, SIAM Review 40 (1998).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc.vehicle.vehicle_code import N_THRUST, evaluate_functions

_STEP = 1e-30


def slope(function: Callable[[Numbers], Numbers], at: Any) -> Floats:
    """Jacobian [output, input] of a function of [input, point] at a real vector, by one call with complex steps."""
    at = np.asarray(at, dtype=np.float64)
    return np.asarray(np.imag(function(at[:, None] + 1j * _STEP * np.eye(at.size))) / _STEP)


def table_rows(tables: Tables, variables: Numbers) -> Numbers:
    """Every table's value, [row, ...]: linear in each axis inside a cell, held outside the grid."""
    low, weight = [], []
    for variable, start, length in zip(tables.axis_variable, tables.axis_start, tables.axis_length, strict=True):
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


def engine_at(vehicle: Vehicle, variables: Numbers, density: Any, speed: Any) -> Numbers:
    """Force (N), moment (N m, about the aerodynamics' point), fuel flow of an engine function, or zeros: [7, ...]."""
    if not vehicle.foreign.propulsion:
        return np.zeros((N_THRUST, *variables.shape[1:]))
    _, made = evaluate_functions(vehicle, variables, density, speed)
    fx, fy, fz = made[:3]
    x, z = vehicle.foreign.engine_x, vehicle.foreign.engine_z
    arm = np.stack([-z * fy, z * fx - x * fz, x * fy])
    return np.concatenate([made[:3], made[3:6] + arm, made[6:]])


def thrust_at(vehicle: Vehicle, fixed: dict[str, Numbers], eta: Any, density: Any, speed: Any) -> Numbers:
    """Magnitude of the thrust of an engine of tables, N."""
    stream = vehicle.constants.capture_thrust * eta * density * speed * fixed["capture_area_ratio"]
    return np.asarray(stream * fixed["specific_impulse"] + 0.5 * density * speed * speed * fixed["thrust_area"])
