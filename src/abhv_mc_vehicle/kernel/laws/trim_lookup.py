"""Look-up of the trim tables in all lanes; each lane keeps its cell from tick to tick."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.tables import bracket, mix, natural, weigh
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import aligned_zeros
from abhv_mc_vehicle.kernel.plant.vehicle import CHUNK

AXES = 3  # number of axes: Mach, angle of attack, equivalence ratio

# Quantities of the trim tables: unlimited elevator, rad; lift and drag coefficients; thrust divided
# by dynamic pressure and area; specific impulse, s.
TRIM_ROWS = ("elevator", "lift", "drag", "thrust", "specific_impulse")
ELEVATOR, LIFT, DRAG, THRUST, IMPULSE = range(len(TRIM_ROWS))


class TrimCells(NamedTuple):
    """Table cell of each lane on each axis, and buffers for the interpolated values."""

    cell: Ints  # cell of each lane [axis, lane]
    low: Floats  # [axis, lane] lower end of the cell
    high: Floats  # [axis, lane] upper end of the cell
    per_step: Floats  # [axis, lane] 1 / length of the cell
    fraction: Floats  # [axis, lane] position within the cell, as a fraction of its length
    value: Floats  # buffer of values [CHUNK]
    slope: Floats  # buffer of slopes [CHUNK]


def make_trim_cells(width: int) -> TrimCells:
    """Return memory for ``width`` lanes, with empty cells that make the first look-up search."""
    shapes: list[tuple[int, ...]] = [(AXES, width)] * 4 + [(CHUNK,)] * 2
    return TrimCells(aligned_zeros((AXES, width), np.int64), *map(aligned_zeros, shapes))


@lanes
def follow(Z, W, row, tables, axis, cells):
    """Update cell and fraction of every lane on one axis, searching only if necessary."""
    has_left = False
    for lane in range(W):
        x, low = Z[row, lane], cells.low[axis, lane]
        has_left |= not (low <= x < cells.high[axis, lane])
        cells.fraction[axis, lane] = (x - low) * cells.per_step[axis, lane]
    if has_left:
        start = natural(tables.axis_start[axis])
        end = start + natural(tables.axis_length[axis])
        grid, inverse_step = tables.grid[start:end], tables.inverse_step[start:end]
        for lane in range(W):
            i, t = bracket(grid, inverse_step, grid.size, cells.cell[axis, lane], Z[row, lane])
            cells.cell[axis, lane] = i
            cells.low[axis, lane] = grid[i]
            cells.high[axis, lane] = grid[i + 1]
            cells.per_step[axis, lane] = inverse_step[i]
            cells.fraction[axis, lane] = t


@scalar
def blend(data, corner, s0, s1, s2, t0, t1, t2, per_step, value, slope):
    """Interpolate all tables of a cell as one vector, with slopes along the middle axis."""
    weights = weigh(t0, t2)
    a, b = natural(corner), natural(corner + s0)
    c, d = natural(corner + s2), natural(corner + s0 + s2)
    e, f = natural(corner + s1), natural(corner + s1 + s0)
    g, h = natural(corner + s1 + s2), natural(corner + s1 + s0 + s2)
    for k in range(CHUNK):
        low = mix(weights, (data[a + k], data[b + k], data[c + k], data[d + k]))
        high = mix(weights, (data[e + k], data[f + k], data[g + k], data[h + k]))
        value[k] = (1.0 - t1) * low + t1 * high
        slope[k] = (high - low) * per_step


@lanes
def look_up_trim(Z, W, trim, cells, alpha_row, eta_row, first_row):
    """Look up trimmed lift, drag and thrust, and derivatives of lift and thrust by alpha.

    The five results are in the rows starting at ``first_row``. The tables depend on Mach number,
    angle of attack and equivalence ratio.
    """
    follow(Z, W, s.V_MACH, trim, 0, cells)
    follow(Z, W, alpha_row, trim, 1, cells)
    follow(Z, W, eta_row, trim, 2, cells)
    s0, s1, s2 = trim.group_stride[0, 0], trim.group_stride[0, 1], trim.group_stride[0, 2]
    start = trim.group_start[0]
    for lane in range(W):
        corner = (
            start + cells.cell[0, lane] * s0 + cells.cell[1, lane] * s1 + cells.cell[2, lane] * s2
        )
        t0, t1, t2 = cells.fraction[0, lane], cells.fraction[1, lane], cells.fraction[2, lane]
        blend(
            trim.data,
            corner,
            s0,
            s1,
            s2,
            t0,
            t1,
            t2,
            cells.per_step[1, lane],
            cells.value,
            cells.slope,
        )
        Z[first_row, lane] = cells.value[LIFT]
        Z[first_row + 1, lane] = cells.value[DRAG]
        Z[first_row + 2, lane] = cells.value[THRUST]
        Z[first_row + 3, lane] = cells.slope[LIFT]
        Z[first_row + 4, lane] = cells.slope[THRUST]
