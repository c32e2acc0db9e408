"""Compiled multilinear look-up of packed tables: one bracket search per axis serves every table.

Work is done lane by lane, because flights sit in different cells; within a lane all tables of a cell
lie side by side, so the interpolation itself is the vector loop (no gather). Outside its grid an axis is
clamped and the lane's ``outside`` row is set, never silently extrapolated.
"""

from abhv_mc.jit import scalar

CHUNK = 8  # as abhv_mc.vehicle.arrays.CHUNK: group widths are multiples of it


@scalar
def bracket(grid, inverse_step, length, hint, x):
    """Cell of ``x`` on one axis, searched from a hint; the answer does not depend on the hint.

    Returns (cell index 0..length-2, fraction 0..1 of ``x`` clamped to the axis).
    """
    low = grid[0]
    high = grid[length - 1]
    x = x if x > low else low  # a NaN lands on the first node; the state itself is checked elsewhere
    x = x if x < high else high
    i = hint
    while i < length - 2 and x >= grid[i + 1]:
        i += 1
    while i > 0 and x < grid[i]:
        i -= 1
    return i, (x - grid[i]) * inverse_step[i]


@scalar
def mix(a, b, c, d, k, wa, wb, wc, wd):
    """Weighted sum of the k-th value of four corners."""
    return wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k]


@scalar
def store(out, v0, v1, v2, v3, v4, v5, v6, v7):
    """Eight values side by side."""
    out[0] = v0
    out[1] = v1
    out[2] = v2
    out[3] = v3
    out[4] = v4
    out[5] = v5
    out[6] = v6
    out[7] = v7


@scalar
def interpolate_2d(data, corner, s0, s1, t0, t1, out):
    """The CHUNK tables from ``corner`` on of one 2-D cell, into ``out``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    # Views with constant indices and all loads before all stores: so the eight become one vector.
    a = data[corner : corner + CHUNK]
    b = data[corner + s0 : corner + s0 + CHUNK]
    c = data[corner + s1 : corner + s1 + CHUNK]
    d = data[corner + s0 + s1 : corner + s0 + s1 + CHUNK]
    store(
        out,
        mix(a, b, c, d, 0, w00, w10, w01, w11),
        mix(a, b, c, d, 1, w00, w10, w01, w11),
        mix(a, b, c, d, 2, w00, w10, w01, w11),
        mix(a, b, c, d, 3, w00, w10, w01, w11),
        mix(a, b, c, d, 4, w00, w10, w01, w11),
        mix(a, b, c, d, 5, w00, w10, w01, w11),
        mix(a, b, c, d, 6, w00, w10, w01, w11),
        mix(a, b, c, d, 7, w00, w10, w01, w11),
    )


@scalar
def interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, out):
    """The CHUNK tables from ``corner`` on of one 3-D cell, into ``out``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    lower = 1.0 - t2
    a = data[corner : corner + CHUNK]
    b = data[corner + s0 : corner + s0 + CHUNK]
    c = data[corner + s1 : corner + s1 + CHUNK]
    d = data[corner + s0 + s1 : corner + s0 + s1 + CHUNK]
    e = data[corner + s2 : corner + s2 + CHUNK]
    f = data[corner + s0 + s2 : corner + s0 + s2 + CHUNK]
    g = data[corner + s1 + s2 : corner + s1 + s2 + CHUNK]
    h = data[corner + s0 + s1 + s2 : corner + s0 + s1 + s2 + CHUNK]
    store(
        out,
        lower * mix(a, b, c, d, 0, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 0, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 1, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 1, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 2, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 2, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 3, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 3, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 4, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 4, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 5, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 5, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 6, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 6, w00, w10, w01, w11),
        lower * mix(a, b, c, d, 7, w00, w10, w01, w11) + t2 * mix(e, f, g, h, 7, w00, w10, w01, w11),
    )


@scalar
def spread(packed, rows):
    """Eight values side by side into one lane of eight rows."""
    rows[0] = packed[0]
    rows[1] = packed[1]
    rows[2] = packed[2]
    rows[3] = packed[3]
    rows[4] = packed[4]
    rows[5] = packed[5]
    rows[6] = packed[6]
    rows[7] = packed[7]
