"""Derivatives of the coefficients by deflections and sideslip, for control allocation."""

from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.tables import interpolate_3d, natural
from abhv_mc_vehicle.kernel.plant.state import N_COEFFICIENTS, VAR

INPUTS = ("aileron", "rudder", "elevator", "sideslip")
N_INPUTS = len(INPUTS)


class Effectiveness(NamedTuple):
    """Terms of the slopes: ``slope[coefficient, input] += weight * row * variable``."""

    coefficient: Ints  # [term] index of the coefficient
    input: Ints  # [term] index into INPUTS
    row: Ints  # [term] table row, or a slope row after the tables
    variable: Ints  # [term] index of the variable
    weight: Floats  # [term] constant factor
    slope_group: Ints  # [slope] group of tables that is differentiated
    slope_axis: Ints  # [slope] axis of differentiation
    slope_row: Ints  # [slope] first slope row


@lanes
def table_slopes(T, W, tables, effectiveness, cells, high):
    """Compute the slope rows of every lane from the cells and fractions of the last look-up.

    ``high`` [MAX_TABLE_ROWS] is a buffer.
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
            corner = (
                start
                + cells.cell[a0, lane] * s0
                + cells.cell[a1, lane] * s1
                + cells.cell[a2, lane] * s2
            )
            t0, t1, t2 = (
                cells.fraction[a0, lane],
                cells.fraction[a1, lane],
                cells.fraction[a2, lane],
            )
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
    """Store every lane's slopes in rows ``first_row + coefficient * N_INPUTS + input``."""
    for i in range(N_COEFFICIENTS * N_INPUTS):
        for lane in range(W):
            Z[first_row + i, lane] = 0.0
    for term in range(effectiveness.coefficient.size):
        slope = natural(effectiveness.coefficient[term] * N_INPUTS + effectiveness.input[term])
        table, variable = (
            T[natural(effectiveness.row[term])],
            Z[VAR + natural(effectiveness.variable[term])],
        )
        add_weighted(Z[first_row + slope], effectiveness.weight[term], table, variable, W)


@lanes
def add_weighted(total, weight, table, variable, W):
    """Add a term to a slope."""
    for lane in range(W):
        total[lane] += weight * (table[lane] * variable[lane])
