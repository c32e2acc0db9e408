"""Look-up and build-up of the six coefficients in all lanes, and their derivatives."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.tables import (
    bracket,
    corners_of,
    interpolate_1d,
    interpolate_2d,
    interpolate_3d,
    mix,
    natural,
    weigh,
)
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import (
    COEF,
    FIXED,
    MAX_AXES,
    MAX_TABLE_ROWS,
    N_COEFFICIENTS,
    OUTSIDE,
    VAR,
    P,
    aligned_zeros,
)
from abhv_mc_vehicle.kernel.plant.vehicle import FIXED_TABLE_ROWS


class TableCells(NamedTuple):
    """Table cells of the lanes from the last look-up, and buffers for interpolation."""

    cell: Ints  # [axis, lane] cell at which the next search starts
    fraction: Floats  # [axis, lane] position within the cell, as a fraction of its length
    lowest: Ints  # [axis] lowest cell over the lanes
    spread: Ints  # [axis] number of cells from the lowest to the highest
    weight: Floats  # weights of the corners [4, lane]
    row: Floats  # buffer of values [table row]


def make_cells(width: int) -> TableCells:
    """Return the memory for ``width`` lanes before the first look-up."""
    cell = aligned_zeros((MAX_AXES, width), np.int64)
    fraction = aligned_zeros((MAX_AXES, width))
    lowest = aligned_zeros(MAX_AXES, np.int64)
    spread = aligned_zeros(MAX_AXES, np.int64)
    return TableCells(
        cell, fraction, lowest, spread, aligned_zeros((4, width)), aligned_zeros(MAX_TABLE_ROWS)
    )


@lanes
def find_cells(Z, W, tables, cells):
    """Find the cell and fraction of every axis and lane; count values outside the grid.

    Flights of a campaign are mostly in one cell or two neighbouring cells. In this case no search
    is needed and the loop over the lanes is vectorized, which is four times faster.
    """
    for lane in range(W):
        Z[OUTSIDE, lane] = 0.0
    for a in range(tables.axis_start.size):
        start = natural(tables.axis_start[a])
        length = natural(tables.axis_length[a])
        variable = VAR + natural(tables.axis_variable[a])
        grid = tables.grid[start : start + length]
        inverse_step = tables.inverse_step[start : start + length]
        cell = natural(cells.lowest[a])
        last = min(cell + 2, length - 1)
        left = grid[cell]
        middle = grid[cell + 1]
        right = grid[last]
        per_left = inverse_step[cell]
        per_right = inverse_step[cell + 1]
        elsewhere = False
        some_below = False
        some_above = False
        for lane in range(W):
            x = Z[variable, lane]
            above = x >= middle
            elsewhere |= not (left <= x < right)  # The condition is also true for NaN.
            some_below |= not above
            some_above |= above
            cells.cell[a, lane] = cell + 1 if above else cell
            cells.fraction[a, lane] = (x - (middle if above else left)) * (
                per_right if above else per_left
            )
        cells.spread[a] = 1 if some_below and some_above else 0
        cells.lowest[a] = cell if some_below else cell + 1
        if elsewhere:
            search_cells(Z, W, cells, a, grid, inverse_step, length, variable)


@lanes
def search_cells(Z, W, cells, a, grid, inverse_step, length, variable):
    """Search the cells of an axis whose lanes are not in two neighbouring cells."""
    low = grid[0]
    high = grid[length - 1]
    lowest = length
    highest = 0
    for lane in range(W):
        x = Z[variable, lane]
        i, t = bracket(grid, inverse_step, length, min(cells.cell[a, lane], length - 2), x)
        cells.cell[a, lane] = i
        cells.fraction[a, lane] = t
        lowest = min(lowest, i)
        highest = max(highest, i)
        Z[OUTSIDE, lane] += 1.0 if x < low or x > high else 0.0
    cells.lowest[a] = lowest
    cells.spread[a] = highest - lowest


@lanes
def interpolate_groups(T, W, tables, cells):
    """Interpolate all tables from the cells and fractions; store them in T [row, lane].

    If all lanes are in one cell, or in two neighbouring cells of a 1-D or 2-D table, they use the
    same corner values and the loop over lanes is vectorized. Otherwise each lane loads its own
    corner values and the loop over contiguous tables is vectorized. The results are bit-identical;
    a shared cell halves the computing time.
    """
    data = tables.data
    fraction = cells.fraction
    weight = cells.weight
    for g in range(tables.group_start.size):
        axis = tables.group_axis[g]
        stride = tables.group_stride[g]
        a0 = natural(axis[0])
        a1 = natural(axis[1])
        a2 = natural(axis[2])
        s0 = natural(stride[0])
        s1 = natural(stride[1])
        s2 = natural(stride[2])
        start = natural(tables.group_start[g])
        row = natural(tables.group_row[g])
        used = natural(tables.group_used[g])
        flat = tables.group_dimensions[g] == 2
        line = flat and s1 == 0
        spread = (
            cells.spread[a0] + (0 if line else cells.spread[a1]) + (0 if flat else cells.spread[a2])
        )
        c = natural(start + cells.lowest[a0] * s0 + cells.lowest[a1] * s1)
        if line and spread <= 1:
            c = natural(start + cells.lowest[a0] * s0)
            last = s0 if spread == 0 else 2 * s0
            upper = cells.lowest[a0] + 1
            for k in range(used):
                nodes = data[c + k], data[c + k + s0], data[c + k + last]
                choose_nodes(T[row + k], fraction[a0], cells.cell[a0], upper, nodes, W)
        elif flat and not line and spread == 0:
            set_weights(weight, fraction, a0, a1, W)
            # Tables are processed in pairs, because padding makes their number even.
            for k in range(0, used, 2):
                corners = corners_of(data, c + k, s0, s1)
                corners_2 = corners_of(data, c + k + 1, s0, s1)
                share_corners_2d(T[row + k], T[row + k + 1], weight, corners, corners_2, W)
        elif flat and not line and spread == 1:
            set_weights(weight, fraction, a0, a1, W)
            split, further = (a0, s0) if cells.spread[a0] == 1 else (a1, s1)
            upper = cells.lowest[split] + 1
            for k in range(used):
                corners = corners_of(data, c + k, s0, s1)
                corners_up = corners_of(data, c + k + further, s0, s1)
                choose_corners_2d(
                    T[row + k], weight, cells.cell[split], upper, corners, corners_up, W
                )
        elif not flat and spread == 0:
            c = natural(c + cells.lowest[a2] * s2)
            set_weights(weight, fraction, a0, a1, W)
            for k in range(used):
                corners = corners_of(data, c + k, s0, s1)
                corners_up = corners_of(data, c + k + s2, s0, s1)
                share_corners_3d(T[row + k], weight, fraction[a2], corners, corners_up, W)
        else:
            for lane in range(W):
                corner = (
                    start
                    + cells.cell[a0, lane] * s0
                    + cells.cell[a1, lane] * s1
                    + cells.cell[a2, lane] * s2
                )
                t0 = fraction[a0, lane]
                t1 = fraction[a1, lane]
                t2 = fraction[a2, lane]
                if line:
                    interpolate_1d(data, corner, s0, t0, used, cells.row)
                elif flat:
                    interpolate_2d(data, corner, s0, s1, t0, t1, used, cells.row)
                else:
                    interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, used, cells.row)
                for k in range(used):
                    T[row + k, lane] = cells.row[k]


@lanes
def set_weights(weights, fractions, a0, a1, W):
    """Compute the weights of a cell's four corners on the first two axes."""
    for lane in range(W):
        weights[0, lane], weights[1, lane], weights[2, lane], weights[3, lane] = weigh(
            fractions[a0, lane], fractions[a1, lane]
        )


@lanes
def choose_nodes(out, fraction, cell, upper, nodes, W):
    """Interpolate a 1-D table between three nodes, for lanes in two neighbouring cells."""
    a, b, c = nodes
    for lane in range(W):
        up = cell[lane] == upper
        t = fraction[lane]
        out[lane] = (1.0 - t) * (b if up else a) + t * (c if up else b)


@lanes
def share_corners_2d(out, out_2, weights, corners, corners_2, W):
    """Interpolate two tables in a 2-D cell that all lanes share."""
    for lane in range(W):
        w = weights[0, lane], weights[1, lane], weights[2, lane], weights[3, lane]
        out[lane] = mix(w, corners)
        out_2[lane] = mix(w, corners_2)


@lanes
def choose_corners_2d(out, weights, cell, upper, corners, corners_up, W):
    """Interpolate a table for lanes in two neighbouring 2-D cells."""
    a, b, c, d = corners
    a_up, b_up, c_up, d_up = corners_up
    for lane in range(W):
        up = cell[lane] == upper
        w = weights[0, lane], weights[1, lane], weights[2, lane], weights[3, lane]
        out[lane] = mix(
            w, (a_up if up else a, b_up if up else b, c_up if up else c, d_up if up else d)
        )


@lanes
def share_corners_3d(out, weights, t2, corners, corners_up, W):
    """Interpolate a table in a 3-D cell that all lanes share."""
    for lane in range(W):
        w = weights[0, lane], weights[1, lane], weights[2, lane], weights[3, lane]
        out[lane] = (1.0 - t2[lane]) * mix(w, corners) + t2[lane] * mix(w, corners_up)


@lanes
def look_up(Z, T, W, tables, cells):
    """Look up all tables; store the values in T [row, lane], and FIXED_TABLE_ROWS in Z."""
    find_cells(Z, W, tables, cells)
    interpolate_groups(T, W, tables, cells)
    for i in range(len(FIXED_TABLE_ROWS)):
        row = T[natural(tables.fixed_row[i])]
        for lane in range(W):
            Z[FIXED + i, lane] = row[lane]


@lanes
def build_up(Z, T, W, terms, factors):
    """Sum the terms (parameter * table * variable) of each coefficient."""
    for c in range(s.N_COEFFICIENTS):
        for lane in range(W):
            Z[COEF + c, lane] = 0.0
    for term in range(terms.coefficient.size):
        total = Z[COEF + natural(terms.coefficient[term])]
        factor = Z[P + natural(factors[term])]
        add_term(
            total, factor, T[natural(terms.table[term])], Z[VAR + natural(terms.variable[term])], W
        )


@lanes
def add_term(total, factor, table, variable, W):
    """Add a term to a coefficient."""
    for lane in range(W):
        total[lane] += factor[lane] * (table[lane] * variable[lane])


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
        a0 = tables.group_axis[g, 0]
        a1 = tables.group_axis[g, 1]
        a2 = tables.group_axis[g, 2]
        s0 = tables.group_stride[g, 0]
        s1 = tables.group_stride[g, 1]
        s2 = tables.group_stride[g, 2]
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
            t0 = cells.fraction[a0, lane]
            t1 = cells.fraction[a1, lane]
            t2 = cells.fraction[a2, lane]
            on_0 = a0 == axis
            on_1 = a1 == axis
            on_2 = a2 == axis
            inverse = tables.inverse_step[tables.axis_start[axis] + cells.cell[axis, lane]]
            l0 = 0.0 if on_0 else t0
            l1 = 0.0 if on_1 else t1
            l2 = 0.0 if on_2 else t2
            h0 = 1.0 if on_0 else t0
            h1 = 1.0 if on_1 else t1
            h2 = 1.0 if on_2 else t2
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
        table = T[natural(effectiveness.row[term])]
        variable = Z[VAR + natural(effectiveness.variable[term])]
        add_weighted(Z[first_row + slope], effectiveness.weight[term], table, variable, W)


@lanes
def add_weighted(total, weight, table, variable, W):
    """Add a term to a slope."""
    for lane in range(W):
        total[lane] += weight * (table[lane] * variable[lane])
