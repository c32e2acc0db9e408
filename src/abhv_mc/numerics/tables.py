"""Compiled multilinear look-up of packed tables: one bracket search per axis serves every table.

Work is done lane by lane, because flights sit in different cells; within a lane all tables of a cell
lie side by side, so the interpolation itself is the vector loop (no gather). Outside its grid an axis is
clamped and the lane's ``outside`` row is set, never silently extrapolated.
"""

from abhv_mc.jit import scalar

CHUNK = 8  # as abhv_mc.vehicle.arrays.CHUNK: group widths are multiples of it


@scalar
def bracket(grid, inverse_step, start, length, hint, x):
    """Cell of ``x`` on one axis, searched from a hint; the answer does not depend on the hint.

    Returns (cell index 0..length-2, fraction 0..1 of ``x`` clamped to the axis).
    """
    low = grid[start]
    high = grid[start + length - 1]
    x = x if x > low else low  # a NaN lands on the first node; the state itself is checked elsewhere
    x = x if x < high else high
    i = hint
    while i < length - 2 and x >= grid[start + i + 1]:
        i += 1
    while i > 0 and x < grid[start + i]:
        i -= 1
    return i, (x - grid[start + i]) * inverse_step[start + i]


@scalar
def interpolate_2d(data, corner, stride_0, stride_1, t0, t1, width, out):
    """All ``width`` tables of one 2-D cell, into ``out``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    for first in range(0, width, CHUNK):
        c00 = corner + first
        for k in range(CHUNK):
            out[first + k] = (
                w00 * data[c00 + k]
                + w10 * data[c00 + stride_0 + k]
                + w01 * data[c00 + stride_1 + k]
                + w11 * data[c00 + stride_0 + stride_1 + k]
            )


@scalar
def interpolate_3d(data, corner, stride_0, stride_1, stride_2, t0, t1, t2, width, out):
    """All ``width`` tables of one 3-D cell, into ``out``."""
    w00 = (1.0 - t0) * (1.0 - t1)
    w10 = t0 * (1.0 - t1)
    w01 = (1.0 - t0) * t1
    w11 = t0 * t1
    s2 = 1.0 - t2
    for first in range(0, width, CHUNK):
        c = corner + first
        for k in range(CHUNK):
            lower = (
                w00 * data[c + k]
                + w10 * data[c + stride_0 + k]
                + w01 * data[c + stride_1 + k]
                + w11 * data[c + stride_0 + stride_1 + k]
            )
            upper = (
                w00 * data[c + stride_2 + k]
                + w10 * data[c + stride_0 + stride_2 + k]
                + w01 * data[c + stride_1 + stride_2 + k]
                + w11 * data[c + stride_0 + stride_1 + stride_2 + k]
            )
            out[first + k] = s2 * lower + t2 * upper


@scalar
def interpolate_group(tables, group, cell, fraction, out):
    """Interpolate one group at the cells and fractions of the axes, into ``out[:group_width]``."""
    a0 = tables.group_axis[group, 0]
    a1 = tables.group_axis[group, 1]
    s0 = tables.group_stride[group, 0]
    s1 = tables.group_stride[group, 1]
    width = tables.group_width[group]
    corner = tables.group_start[group] + cell[a0] * s0 + cell[a1] * s1
    if tables.group_dimensions[group] == 2:
        interpolate_2d(tables.data, corner, s0, s1, fraction[a0], fraction[a1], width, out)
    else:
        a2 = tables.group_axis[group, 2]
        s2 = tables.group_stride[group, 2]
        corner += cell[a2] * s2
        interpolate_3d(tables.data, corner, s0, s1, s2, fraction[a0], fraction[a1], fraction[a2], width, out)
