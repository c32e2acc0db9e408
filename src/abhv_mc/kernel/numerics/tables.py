"""Compiled multilinear look-up of packed tables: one bracket search per axis serves every table.

Work is done lane by lane, because flights are in different cells; within a lane all tables of a cell
lie side by side, so the interpolation itself is the vector loop (no gather). Outside its grid an axis is
clamped and the lane's ``outside`` row is set, never silently extrapolated.
"""

from abhv_mc.kernel.jit import scalar


@scalar
def natural(i):
    """An index that is never negative, and known to be: no code to count negative ones from the end."""
    return i & 0x7FFFFFFF


@scalar
def bracket(grid, inverse_step, length, hint, x):
    """Cell of ``x`` on one axis, searched from a hint; the answer does not depend on the hint.

    Returns (cell index 0..length-2, fraction 0..1 of ``x`` clamped to the axis).
    """
    low = grid[0]
    high = grid[length - 1]
    x = (
        x if x > low else low
    )  # a NaN lands on the first node; the state itself is checked elsewhere
    x = x if x < high else high
    i = natural(hint)
    while i < length - 2 and x >= grid[natural(i + 1)]:
        i += 1
    while i > 0 and x < grid[natural(i)]:
        i -= 1
    i = natural(i)
    return i, (x - grid[i]) * inverse_step[i]


@scalar
def weigh(t0, t1):
    """Weights of the four corners of a 2-D cell."""
    return (1.0 - t0) * (1.0 - t1), t0 * (1.0 - t1), (1.0 - t0) * t1, t0 * t1


@scalar
def corners_of(data, i, s0, s1):
    """One table's values at the four corners of a 2-D cell."""
    return data[i], data[i + s0], data[i + s1], data[i + s0 + s1]


@scalar
def mix(weights, corners):
    """Corners' values by their weights."""
    w00, w10, w01, w11 = weights
    a, b, c, d = corners
    return w00 * a + w10 * b + w01 * c + w11 * d


@scalar
def interpolate_1d(data, corner, s0, t0, width, out):
    """The ``width`` tables that lie side by side from ``corner`` on, between two nodes, into ``out[:width]``."""
    a, b = natural(corner), natural(corner + s0)
    for k in range(width):
        out[k] = (1.0 - t0) * data[a + k] + t0 * data[b + k]


@scalar
def interpolate_2d(data, corner, s0, s1, t0, t1, width, out):
    """The ``width`` tables that lie side by side from ``corner`` on, in one 2-D cell, into ``out[:width]``."""
    weights = weigh(t0, t1)
    a, b = natural(corner), natural(corner + s0)
    c, d = natural(corner + s1), natural(corner + s0 + s1)
    for k in range(width):
        out[k] = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))


@scalar
def interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, width, out):
    """The ``width`` tables that lie side by side from ``corner`` on, in one 3-D cell, into ``out[:width]``."""
    weights = weigh(t0, t1)
    a, b = natural(corner), natural(corner + s0)
    c, d = natural(corner + s1), natural(corner + s0 + s1)
    e, f = natural(corner + s2), natural(corner + s0 + s2)
    g, h = natural(corner + s1 + s2), natural(corner + s0 + s1 + s2)
    for k in range(width):
        lower = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))
        upper = mix(weights, (data[e + k], data[f + k], data[g + k], data[h + k]))
        out[k] = (1.0 - t2) * lower + t2 * upper
