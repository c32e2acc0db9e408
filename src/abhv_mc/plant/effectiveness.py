"""Slopes of the coefficients with the deflections and with sideslip: what control allocation inverts.

A term ``table * variable`` depends on a deflection through its variable and through a table axis; both are
linear inside a cell, so the slopes are exact there. Which terms have which slope is worked out once per vehicle.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.jit import lanes
from abhv_mc.numerics.tables import interpolate_3d, natural
from abhv_mc.plant.state import N_COEFFICIENTS, VAR
from abhv_mc.vehicle.arrays import VARIABLES
from abhv_mc.vehicle.model import Vehicle

INPUTS = ("aileron", "rudder", "elevator", "sideslip")
N_INPUTS = len(INPUTS)


class Effectiveness(NamedTuple):
    """Terms of the slopes: ``slope[coefficient, input] += weight * row * variable``."""

    coefficient: Ints  # [term]
    input: Ints  # [term] index into INPUTS
    row: Ints  # [term] table row, or a slope row behind the tables
    variable: Ints  # [term]
    weight: Floats  # [term]
    slope_group: Ints  # [slope] group that is differentiated
    slope_axis: Ints  # [slope] the axis with respect to which
    slope_row: Ints  # [slope] its first row


def _input_weights(vehicle: Vehicle) -> Floats:
    """d variable / d input, [variable, input]."""
    weights = np.zeros((len(VARIABLES), N_INPUTS))
    for i, name in enumerate(INPUTS):
        weights[VARIABLES.index(name), i] = 1.0
    first = VARIABLES.index("effector_0")
    for e, mix in enumerate(vehicle.effector_mix):
        weights[first + e, :3] = mix
    return weights


def _slope_rows(vehicle: Vehicle, weights: Floats) -> tuple[dict[tuple[int, int], int], int]:
    """First row of the slopes of each (group, axis) that an input moves, behind the tables; the rows in all."""
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
    """Rows that the vehicle's tables and their slopes fill."""
    return _slope_rows(vehicle, _input_weights(vehicle))[1]


def make_effectiveness(vehicle: Vehicle) -> Effectiveness:
    """Work out the slopes of a vehicle that fits the lane memory (:func:`count_rows`)."""
    weights = _input_weights(vehicle)
    tables, terms = vehicle.tables, vehicle.build_up
    found: list[tuple[int, int, int, int, float]] = []
    slope_rows, _ = _slope_rows(vehicle, weights)
    one = VARIABLES.index("one")
    for c, table, variable in zip(terms.coefficient, terms.table, terms.variable, strict=True):
        for i in range(N_INPUTS):
            if weights[variable, i]:
                found.append((int(c), i, int(table), one, float(weights[variable, i])))
        for (group, axis), first_row in slope_rows.items():
            offset = int(table - tables.group_row[group])
            if 0 <= offset < tables.group_width[group]:
                for i in range(N_INPUTS):
                    weight = weights[tables.axis_variable[axis], i]
                    if weight:
                        found.append((int(c), i, first_row + offset, int(variable), float(weight)))
    terms_table = np.array(found, dtype=np.float64).reshape(-1, 5)
    slopes = [(group, axis, row) for (group, axis), row in slope_rows.items()]
    slopes_table = np.array(slopes, dtype=np.int64).reshape(-1, 3)
    coefficient, inputs, row, variable = (terms_table[:, i].astype(np.int64) for i in range(4))
    return Effectiveness(
        coefficient=coefficient,
        input=inputs,
        row=row,
        variable=variable,
        weight=np.ascontiguousarray(terms_table[:, 4]),
        slope_group=np.ascontiguousarray(slopes_table[:, 0]),
        slope_axis=np.ascontiguousarray(slopes_table[:, 1]),
        slope_row=np.ascontiguousarray(slopes_table[:, 2]),
    )


@lanes
def table_slopes(T, W, tables, effectiveness, cells, high):
    """Slope rows of every lane, from the cells and fractions that the look-up just found.

    high [MAX_TABLE_ROWS] is scratch.
    """
    low = cells.row
    for slope in range(effectiveness.slope_group.size):
        g = effectiveness.slope_group[slope]
        axis = effectiveness.slope_axis[slope]
        a0, a1, a2 = tables.group_axis[g, 0], tables.group_axis[g, 1], tables.group_axis[g, 2]
        s0, s1, s2 = tables.group_stride[g, 0], tables.group_stride[g, 1], tables.group_stride[g, 2]
        start = tables.group_start[g]
        used = tables.group_used[g]
        row = effectiveness.slope_row[slope]
        for lane in range(W):
            corner = start + cells.cell[a0, lane] * s0 + cells.cell[a1, lane] * s1 + cells.cell[a2, lane] * s2
            t0, t1, t2 = cells.fraction[a0, lane], cells.fraction[a1, lane], cells.fraction[a2, lane]
            on_0, on_1, on_2 = a0 == axis, a1 == axis, a2 == axis
            inverse = tables.inverse_step[tables.axis_start[axis] + cells.cell[axis, lane]]
            l0, l1, l2 = 0.0 if on_0 else t0, 0.0 if on_1 else t1, 0.0 if on_2 else t2
            h0, h1, h2 = 1.0 if on_0 else t0, 1.0 if on_1 else t1, 1.0 if on_2 else t2
            interpolate_3d(tables.data, corner, s0, s1, s2, l0, l1, l2, used, low)
            interpolate_3d(tables.data, corner, s0, s1, s2, h0, h1, h2, used, high)
            for k in range(used):
                T[row + k, lane] = (high[k] - low[k]) * inverse


@lanes
def slopes_of_coefficients(Z, T, W, effectiveness, first_row):
    """Rows ``first_row + coefficient * N_INPUTS + input`` of every lane."""
    for i in range(N_COEFFICIENTS * N_INPUTS):
        for lane in range(W):
            Z[first_row + i, lane] = 0.0
    for term in range(effectiveness.coefficient.size):
        slope = natural(effectiveness.coefficient[term] * N_INPUTS + effectiveness.input[term])
        add_weighted(
            Z[first_row + slope],
            effectiveness.weight[term],
            T[natural(effectiveness.row[term])],
            Z[VAR + natural(effectiveness.variable[term])],
            W,
        )


@lanes
def add_weighted(total, weight, table, variable, W):
    """One term of a slope."""
    for lane in range(W):
        total[lane] += weight * (table[lane] * variable[lane])
