"""Compiled multilinear look-up of packed tables, with one search per axis.

Lanes are processed one by one, because flights are in different cells. Within a lane, all tables of
a cell are contiguous, so the loop over tables is vectorized without gather instructions. Arguments
outside the grid are clamped, and the lane's ``outside`` row is set; there is no extrapolation.
"""

from abhv_mc_vehicle.kernel.jit import scalar


@scalar
def natural(i):
    """Return an index in a form that shows the compiler that the index is not negative."""
    return i & 0x7FFFFFFF


@scalar
def bracket(grid, inverse_step, length, hint, x):
    """Return the cell (0..length-2) of ``x`` and its fraction (0..1), clamped to the axis.

    The search starts at ``hint``, which does not affect the result.
    """
    low = grid[0]
    high = grid[length - 1]
    # NaN is replaced by the first node, because non-finite states are detected elsewhere.
    x = x if x > low else low
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
    """Return the weights of the four corners of a 2-D cell."""
    return (1.0 - t0) * (1.0 - t1), t0 * (1.0 - t1), (1.0 - t0) * t1, t0 * t1


@scalar
def corners_of(data, i, s0, s1):
    """Return a table's values at the four corners of a 2-D cell."""
    return data[i], data[i + s0], data[i + s1], data[i + s0 + s1]


@scalar
def mix(weights, corners):
    """Return the weighted sum of the values at the corners."""
    w00, w10, w01, w11 = weights
    a, b, c, d = corners
    return w00 * a + w10 * b + w01 * c + w11 * d


@scalar
def interpolate_1d(data, corner, s0, t0, width, out):
    """Interpolate ``width`` contiguous tables between two nodes, starting at ``corner``.

    The results are stored in ``out``.
    """
    a = natural(corner)
    b = natural(corner + s0)
    for k in range(width):
        out[k] = (1.0 - t0) * data[a + k] + t0 * data[b + k]


@scalar
def interpolate_2d(data, corner, s0, s1, t0, t1, width, out):
    """Interpolate ``width`` contiguous tables within one 2-D cell, starting at ``corner``.

    The results are stored in ``out``.
    """
    weights = weigh(t0, t1)
    a = natural(corner)
    b = natural(corner + s0)
    c = natural(corner + s1)
    d = natural(corner + s0 + s1)
    for k in range(width):
        out[k] = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))


@scalar
def interpolate_3d(data, corner, s0, s1, s2, t0, t1, t2, width, out):
    """Interpolate ``width`` contiguous tables within one 3-D cell, starting at ``corner``.

    The results are stored in ``out``.
    """
    weights = weigh(t0, t1)
    a = natural(corner)
    b = natural(corner + s0)
    c = natural(corner + s1)
    d = natural(corner + s0 + s1)
    e = natural(corner + s2)
    f = natural(corner + s0 + s2)
    g = natural(corner + s1 + s2)
    h = natural(corner + s0 + s1 + s2)
    for k in range(width):
        lower = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))
        upper = mix(weights, (data[e + k], data[f + k], data[g + k], data[h + k]))
        out[k] = (1.0 - t2) * lower + t2 * upper
