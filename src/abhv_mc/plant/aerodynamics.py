"""Tables and build-up in lanes: variables -> table rows -> the six coefficients."""

from abhv_mc.jit import lanes
from abhv_mc.numerics.tables import bracket, interpolate_2d, interpolate_3d
from abhv_mc.plant.state import COEF, FIXED, N_COEFFICIENTS, OUTSIDE, VAR, P
from abhv_mc.vehicle.arrays import FIXED_TABLE_ROWS

N_FIXED = len(FIXED_TABLE_ROWS)


@lanes
def find_cells(Z, W, tables, hints, fractions):
    """Cell and fraction of every axis and lane: hints [axis, lane] keep the cells, fractions [axis, lane].

    ``OUTSIDE`` counts the axes whose tables are left.
    """
    for lane in range(W):
        Z[OUTSIDE, lane] = 0.0
    for a in range(tables.axis_start.size):
        start = tables.axis_start[a]
        length = tables.axis_length[a]
        variable = VAR + tables.axis_variable[a]
        grid = tables.grid[start : start + length]
        inverse_step = tables.inverse_step[start : start + length]
        low, high = grid[0], grid[length - 1]
        for lane in range(W):
            x = Z[variable, lane]
            i, t = bracket(grid, inverse_step, length, hints[a, lane], x)
            hints[a, lane] = i
            fractions[a, lane] = t
            Z[OUTSIDE, lane] += 1.0 if x < low or x > high else 0.0


@lanes
def interpolate_groups(T, W, tables, hints, fractions):
    """Every table's value, T [lane, row], from the cells and fractions.

    Lane by lane, because flights sit in different cells; the tables of a cell are the vector (measured: half the
    time of rows over lanes, which need gathers or a transposition).
    """
    for g in range(tables.group_start.size):
        a0, a1, a2 = tables.group_axis[g, 0], tables.group_axis[g, 1], tables.group_axis[g, 2]
        s0, s1, s2 = tables.group_stride[g, 0], tables.group_stride[g, 1], tables.group_stride[g, 2]
        start = tables.group_start[g]
        row = tables.group_row[g]
        width = tables.group_width[g]
        if tables.group_dimensions[g] == 2:
            for lane in range(W):
                corner = start + hints[a0, lane] * s0 + hints[a1, lane] * s1
                t0, t1 = fractions[a0, lane], fractions[a1, lane]
                interpolate_2d(tables.data, corner, s0, s1, t0, t1, width, T[lane, row : row + width])
        else:
            for lane in range(W):
                corner = start + hints[a0, lane] * s0 + hints[a1, lane] * s1 + hints[a2, lane] * s2
                t0, t1, t2 = fractions[a0, lane], fractions[a1, lane], fractions[a2, lane]
                interpolate_3d(tables.data, corner, s0, s1, s2, t0, t1, t2, width, T[lane, row : row + width])


@lanes
def look_up(Z, T, W, tables, hints, fractions):
    """All tables of every lane at its variables: T [lane, row], and the fixed quantities as rows of Z."""
    find_cells(Z, W, tables, hints, fractions)
    interpolate_groups(T, W, tables, hints, fractions)
    for i in range(N_FIXED):
        row = tables.fixed_row[i]
        for lane in range(W):
            Z[FIXED + i, lane] = T[lane, row]


@lanes
def build_up(Z, T, W, terms, factors):
    """Sum the terms of each coefficient: factor * table * variable. ``factors`` names the parameter rows."""
    for c in range(N_COEFFICIENTS):
        for lane in range(W):
            Z[COEF + c, lane] = 0.0
    for term in range(terms.coefficient.size):
        coefficient = COEF + terms.coefficient[term]
        table = terms.table[term]
        variable = VAR + terms.variable[term]
        factor = P + factors[term]
        for lane in range(W):
            Z[coefficient, lane] += Z[factor, lane] * (T[lane, table] * Z[variable, lane])
