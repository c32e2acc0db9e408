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
def all_in_one_cell(hints, axis, W):
    """Whether every lane sits in the first lane's cell of an axis."""
    different = 0
    for lane in range(W):
        different += hints[axis, lane] != hints[axis, 0]
    return different == 0


@lanes
def interpolate_groups(T, W, tables, hints, fractions, weights, scratch):
    """Every table's value, T [row, lane], from the cells and fractions. weights [4, lane], scratch [row].

    Flights of one campaign mostly share a cell: then its corners are plain numbers and lanes the vector. Where they
    do not, each lane fetches its own corners and the tables side by side are the vector. The arithmetic is the same,
    bit for bit; sharing the cell takes half the time.
    """
    data = tables.data
    for g in range(tables.group_start.size):
        a0, a1, a2 = tables.group_axis[g, 0], tables.group_axis[g, 1], tables.group_axis[g, 2]
        s0, s1, s2 = tables.group_stride[g, 0], tables.group_stride[g, 1], tables.group_stride[g, 2]
        start = tables.group_start[g]
        row = tables.group_row[g]
        used = tables.group_used[g]
        flat = tables.group_dimensions[g] == 2
        shared = all_in_one_cell(hints, a0, W) and all_in_one_cell(hints, a1, W)
        if flat and shared:
            c = start + hints[a0, 0] * s0 + hints[a1, 0] * s1
            set_weights(weights, fractions, a0, a1, W)
            for k in range(used):
                share_corners_2d(
                    T[row + k], weights, data[c + k], data[c + s0 + k], data[c + s1 + k], data[c + s0 + s1 + k], W
                )
        elif flat:
            for lane in range(W):
                corner = start + hints[a0, lane] * s0 + hints[a1, lane] * s1
                interpolate_2d(data, corner, s0, s1, fractions[a0, lane], fractions[a1, lane], used, scratch)
                for k in range(used):
                    T[row + k, lane] = scratch[k]
        elif shared and all_in_one_cell(hints, a2, W):
            c = start + hints[a0, 0] * s0 + hints[a1, 0] * s1 + hints[a2, 0] * s2
            set_weights(weights, fractions, a0, a1, W)
            for k in range(used):
                share_corners_3d(
                    T[row + k],
                    weights,
                    fractions[a2],
                    data[c + k],
                    data[c + s0 + k],
                    data[c + s1 + k],
                    data[c + s0 + s1 + k],
                    data[c + s2 + k],
                    data[c + s0 + s2 + k],
                    data[c + s1 + s2 + k],
                    data[c + s0 + s1 + s2 + k],
                    W,
                )
        else:
            for lane in range(W):
                corner = start + hints[a0, lane] * s0 + hints[a1, lane] * s1 + hints[a2, lane] * s2
                t0, t1, t2 = fractions[a0, lane], fractions[a1, lane], fractions[a2, lane]
                interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, used, scratch)
                for k in range(used):
                    T[row + k, lane] = scratch[k]


@lanes
def set_weights(weights, fractions, a0, a1, W):
    """Weights of the four corners in the first two axes."""
    for lane in range(W):
        t0, t1 = fractions[a0, lane], fractions[a1, lane]
        weights[0, lane] = (1.0 - t0) * (1.0 - t1)
        weights[1, lane] = t0 * (1.0 - t1)
        weights[2, lane] = (1.0 - t0) * t1
        weights[3, lane] = t0 * t1


@lanes
def share_corners_2d(out, weights, a, b, c, d, W):
    """One table of a 2-D cell that all lanes share."""
    for lane in range(W):
        out[lane] = weights[0, lane] * a + weights[1, lane] * b + weights[2, lane] * c + weights[3, lane] * d


@lanes
def share_corners_3d(out, weights, t2, a, b, c, d, e, f, g, h, W):
    """One table of a 3-D cell that all lanes share."""
    for lane in range(W):
        w00, w10, w01, w11 = weights[0, lane], weights[1, lane], weights[2, lane], weights[3, lane]
        lower = w00 * a + w10 * b + w01 * c + w11 * d
        upper = w00 * e + w10 * f + w01 * g + w11 * h
        out[lane] = (1.0 - t2[lane]) * lower + t2[lane] * upper


@lanes
def look_up(Z, T, W, tables, hints, fractions, weights, scratch):
    """All tables of every lane at its variables: T [row, lane], and the fixed quantities as rows of Z."""
    find_cells(Z, W, tables, hints, fractions)
    interpolate_groups(T, W, tables, hints, fractions, weights, scratch)
    for i in range(N_FIXED):
        row = T[tables.fixed_row[i]]
        for lane in range(W):
            Z[FIXED + i, lane] = row[lane]


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
            Z[coefficient, lane] += Z[factor, lane] * (T[table, lane] * Z[variable, lane])
