"""The nominal vehicle in numpy where an argument may be complex: a complex step gives a cell's exact slope.

Real-valued twin: :mod:`abhv_mc.vehicle.evaluate`. Complex step: Squire and Trapp, SIAM Review 40 (1998). SI, radians.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.kernel.plant.vehicle import COEFFICIENTS, FIXED_TABLE_ROWS, VARIABLES, Tables, Vehicle
from abhv_mc.vehicle.vehicle_code import N_THRUST, evaluate_functions

Numbers = NDArray[Any]  # float64 or complex128
_STEP = 1e-30


def slope(function: Callable[[Numbers], Numbers], at: Any) -> Floats:
    """Jacobian [output, input] of a function of [input, point] at a real vector, by one call with complex steps."""
    at = np.asarray(at, dtype=np.float64)
    return np.asarray(np.imag(function(at[:, None] + 1j * _STEP * np.eye(at.size))) / _STEP)


def variables_at(vehicle: Vehicle, **values: Any) -> dict[str, Numbers]:
    """Every one of VARIABLES: named values broadcast against each other, effectors mixed, the rest zero."""
    arrays = dict(zip(values, np.broadcast_arrays(*values.values()), strict=True))
    shape = next(iter(arrays.values())).shape
    result = {name: np.asarray(arrays.get(name, np.zeros(shape))) for name in VARIABLES}
    result["one"] = np.ones(shape)
    for effector, mix in enumerate(vehicle.effector_mix):
        aileron, rudder, elevator = mix
        result[f"effector_{effector}"] = np.asarray(
            aileron * result["aileron"] + rudder * result["rudder"] + elevator * result["elevator"]
        )
    return result


def table_rows(tables: Tables, variables: dict[str, Numbers]) -> Numbers:
    """Every table's value, [row, ...]: linear in each axis inside a cell, held outside the grid."""
    low, weight = [], []
    for variable, start, length in zip(tables.axis_variable, tables.axis_start, tables.axis_length, strict=True):
        grid = tables.grid[start : start + length]
        x = variables[VARIABLES[variable]]
        cell = np.clip(np.searchsorted(grid, x.real, side="right") - 1, 0, length - 2)
        fraction = (x - grid[cell]) / (grid[cell + 1] - grid[cell])
        fraction = np.where(fraction.real < 0.0, 0.0, np.where(fraction.real > 1.0, 1.0, fraction))
        low.append(cell)
        weight.append(fraction)
    shape = variables["one"].shape
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


def fixed_values(tables: Tables, rows: Numbers) -> dict[str, Numbers]:
    """The rows that every vehicle has, by the names of FIXED_TABLE_ROWS."""
    return {name: rows[row] for name, row in zip(FIXED_TABLE_ROWS, tables.fixed_row, strict=True)}


def coefficients_at(vehicle: Vehicle, rows: Numbers, variables: dict[str, Numbers]) -> dict[str, Numbers]:
    """The nominal vehicle's six coefficients, by the names of COEFFICIENTS."""
    if vehicle.foreign.aerodynamics:
        made, _ = evaluate_functions(vehicle, stack_variables(variables))
        return dict(zip(COEFFICIENTS, made, strict=True))
    total: dict[str, Numbers] = {name: np.zeros(rows.shape[1:], dtype=rows.dtype) for name in COEFFICIENTS}
    terms = vehicle.build_up
    for coefficient, table, variable in zip(terms.coefficient, terms.table, terms.variable, strict=True):
        name = COEFFICIENTS[coefficient]
        total[name] = total[name] + rows[table] * variables[VARIABLES[variable]]
    return total


def stack_variables(variables: dict[str, Numbers]) -> Numbers:
    """``[variable, ...]`` from the variables by name."""
    return np.stack(np.broadcast_arrays(*(variables[name] for name in VARIABLES)))


def engine_at(vehicle: Vehicle, variables: dict[str, Numbers], density: Any, speed: Any) -> Numbers:
    """Force (N), moment (N m, about the aerodynamics' point), fuel flow of an engine function, or zeros: [7, ...]."""
    if not vehicle.foreign.propulsion:
        return np.zeros((N_THRUST, *variables["one"].shape))
    _, made = evaluate_functions(vehicle, stack_variables(variables), density, speed)
    fx, fy, fz = made[:3]
    x, z = vehicle.foreign.engine_x, vehicle.foreign.engine_z
    arm = np.stack([-z * fy, z * fx - x * fz, x * fy])
    return np.concatenate([made[:3], made[3:6] + arm, made[6:]])


def thrust_at(vehicle: Vehicle, fixed: dict[str, Numbers], eta: Any, density: Any, speed: Any) -> Numbers:
    """Magnitude of the thrust of an engine of tables, N."""
    stream = vehicle.constants.capture_thrust * eta * density * speed * fixed["capture_area_ratio"]
    return np.asarray(stream * fixed["specific_impulse"] + 0.5 * density * speed * speed * fixed["thrust_area"])
