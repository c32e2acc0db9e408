"""Derivatives of coefficients with respect to deflections, for control allocation.

A term ``table * variable`` may depend on a deflection through the variable and through an axis of
the table. Both dependences are linear inside a table cell, so the derivatives are exact. The list
of derivatives is computed once per vehicle.
"""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.plant.aerodynamics import INPUTS, N_INPUTS, Effectiveness
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES, Vehicle


def _input_weights(vehicle: Vehicle) -> Floats:
    """Return the derivatives [variable, input] of variables with respect to inputs."""
    weights = np.zeros((len(VARIABLES), N_INPUTS))
    for i, name in enumerate(INPUTS):
        weights[VARIABLES.index(name), i] = 1.0
    first = VARIABLES.index("effector_0")
    for e, mix in enumerate(vehicle.effector_mix):
        weights[first + e, :3] = mix
    return weights


def _slope_rows(vehicle: Vehicle, weights: Floats) -> tuple[dict[tuple[int, int], int], int]:
    """Return the first slope row of each (group, axis) that depends on inputs.

    The second result is the total number of rows.
    """
    tables = vehicle.tables
    rows: dict[tuple[int, int], int] = {}
    end = int(tables.n_rows)
    for group in range(tables.group_start.size):
        for d in range(tables.group_dimensions[group]):
            axis = int(tables.group_axis[group, d])
            if tables.group_stride[group, d] and weights[tables.axis_variable[axis]].any():
                rows[group, axis] = end
                end += int(tables.group_width[group])
    return rows, end


def count_rows(vehicle: Vehicle) -> int:
    """Return the total number of rows of a vehicle's tables and of their slopes."""
    return _slope_rows(vehicle, _input_weights(vehicle))[1]


def make_effectiveness(vehicle: Vehicle) -> Effectiveness:
    """Return the terms of the coefficients' derivatives, see :class:`Effectiveness`."""
    weights = _input_weights(vehicle)
    tables = vehicle.tables
    terms = vehicle.build_up
    entries: list[tuple[int, int, int, int, float]] = []
    slope_rows, _ = _slope_rows(vehicle, weights)
    constant = VARIABLES.index("one")
    for c, table, variable in zip(terms.coefficient, terms.table, terms.variable, strict=True):
        for i in range(N_INPUTS):
            if weights[variable, i]:
                entries.append((int(c), i, int(table), constant, float(weights[variable, i])))
        for (group, axis), first_row in slope_rows.items():
            offset = int(table - tables.group_row[group])
            if 0 <= offset < tables.group_width[group]:
                for i in range(N_INPUTS):
                    weight = weights[tables.axis_variable[axis], i]
                    if weight:
                        entries.append(
                            (int(c), i, first_row + offset, int(variable), float(weight))
                        )
    slopes = [(group, axis, row) for (group, axis), row in slope_rows.items()]
    slope_group, slope_axis, slope_row = np.array(slopes, np.int64).reshape(-1, 3).T.copy()
    *columns, weight = np.array(entries, np.float64).reshape(-1, 5).T.copy()
    coefficient, inputs, row, variable = (column.astype(np.int64) for column in columns)
    return Effectiveness(
        coefficient=coefficient,
        input=inputs,
        row=row,
        variable=variable,
        weight=weight,
        slope_group=slope_group,
        slope_axis=slope_axis,
        slope_row=slope_row,
    )
