"""Compiled multilinear look-up of packed tables: one bracket search per axis serves every table.

Work is done lane by lane, because flights sit in different cells; within a lane all tables of a cell
lie side by side, so the interpolation itself is the vector loop (no gather). Outside its grid an axis is
clamped and the lane's ``outside`` row is set, never silently extrapolated.
"""

from abhv_mc.jit import scalar


@scalar
def natural(i):
    """An index that is never negative, and known to be: no code to count negative ones from the end.

    (A third of the look-up's instructions were that.)
    """
    return i & 0x7FFFFFFF


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
def interpolate_2d(data, corner, s0, s1, t0, t1, width, out):
    """The ``width`` tables that lie side by side from ``corner`` on, in one 2-D cell, into ``out[:width]``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    # Views, so that the index of the loop is its only index: no wrap-around of negative ones, hence vector code.
    a = data[corner : corner + width]
    b = data[corner + s0 : corner + s0 + width]
    c = data[corner + s1 : corner + s1 + width]
    d = data[corner + s0 + s1 : corner + s0 + s1 + width]
    for k in range(width):
        out[k] = w00 * a[k] + w10 * b[k] + w01 * c[k] + w11 * d[k]


@scalar
def interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, width, out):
    """The ``width`` tables that lie side by side from ``corner`` on, in one 3-D cell, into ``out[:width]``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    lower = 1.0 - t2
    a = data[corner : corner + width]
    b = data[corner + s0 : corner + s0 + width]
    c = data[corner + s1 : corner + s1 + width]
    d = data[corner + s0 + s1 : corner + s0 + s1 + width]
    e = data[corner + s2 : corner + s2 + width]
    f = data[corner + s0 + s2 : corner + s0 + s2 + width]
    g = data[corner + s1 + s2 : corner + s1 + s2 + width]
    h = data[corner + s0 + s1 + s2 : corner + s0 + s1 + s2 + width]
    for k in range(width):
        out[k] = lower * (w00 * a[k] + w10 * b[k] + w01 * c[k] + w11 * d[k]) + t2 * (
            w00 * e[k] + w10 * f[k] + w01 * g[k] + w11 * h[k]
        )
