"""The packed form of a vehicle: plain arrays that the compiled plant reads.

A vehicle file (any tables, any build-up) is turned once into these named tuples.
They are arguments of the compiled code, not constants of it: one compiled flight
serves every vehicle, and a changed table can never meet a stale cache.
"""

from typing import NamedTuple

from abhv_mc.array_types import Floats, Ints

MAX_EFFECTORS = 16  # surfaces of a vehicle's own
MAX_ENGINES = 4

# What a table axis or a build-up term may depend on, SI and radians.
# The effectors are the vehicle's own surfaces, mixed from the three axis deflections.
VARIABLES = (
    "one",
    "mach",
    "angle_of_attack",
    "sideslip",
    "roll_rate_hat",  # p b / (2 V)
    "pitch_rate_hat",  # q c / (2 V)
    "yaw_rate_hat",  # r b / (2 V)
    "aileron",
    "rudder",
    "elevator",
    "equivalence_ratio",
    "altitude",
    "mass",
    *(f"effector_{i}" for i in range(MAX_EFFECTORS)),
)

# Lift and drag are in stability axes (from alpha), side force along body y; moments about body axes.
COEFFICIENTS = ("lift", "drag", "side_force", "rolling_moment", "pitching_moment", "yawing_moment")

# What the plant reads from every vehicle's tables: entry i is table row ``Tables.fixed_row[i]``.
# A vehicle that gives no such table has a constant there.
FIXED_TABLE_ROWS = (
    "capture_area_ratio",  # ca(Mach, alpha); 0 when the vehicle gives a thrust coefficient instead
    "specific_impulse",  # s
    "thrust_area",  # T / q_bar, m2; 0 when the vehicle gives capture area and specific impulse
    "inertia_xx",  # kg m2
    "inertia_yy",
    "inertia_zz",
    "inertia_13",  # matrix element, positive for GHAME
    "center_of_gravity_x",  # m, forward of the moment reference
    "center_of_gravity_z",  # m, down from the moment reference
)

MAX_DIMENSIONS = 3
CHUNK = 8  # doubles of one AVX-512 register, two AVX2 ones


class Tables(NamedTuple):
    """Look-up tables grouped by their axes, all tables of a group side by side in each cell.

    Rows of the output are numbered 0..n_rows-1; a group fills ``group_width`` consecutive
    rows from ``group_row``. Node (i, j, k) of group g starts at
    ``data[group_start[g] + i*stride[g,0] + j*stride[g,1] + k*stride[g,2]]``.
    Every group has two or three dimensions: a 1-D table gets a second axis of stride 0.
    Constants are tables on the variable ``one`` (grid 0, 2), so they never leave the tables.
    """

    axis_variable: Ints  # [axis] index into VARIABLES
    axis_start: Ints  # [axis] first node in grid
    axis_length: Ints  # [axis] number of nodes, at least 2
    grid: Floats  # [node] all axes one after another, strictly increasing within an axis
    inverse_step: Floats  # [node] 1 / (grid[i + 1] - grid[i]); 0 at an axis's last node
    group_dimensions: Ints  # [group] 2 or 3
    group_axis: Ints  # [group, 3] axis index; an unused dimension names axis 0 with stride 0
    group_stride: Ints  # [group, 3]
    group_start: Ints  # [group]
    group_width: Ints  # [group] a multiple of CHUNK: the look-up's vector loop has no remainder; spare rows hold zeros
    group_used: Ints  # [group] tables without the spare ones of the padding
    group_row: Ints  # [group]
    data: Floats  # [value]
    fixed_row: Ints  # [entry] table row of each of FIXED_TABLE_ROWS
    n_rows: int  # number of output rows


class BuildUp(NamedTuple):
    """Coefficient = sum over its terms of factor * table * variable."""

    coefficient: Ints  # [term] index into COEFFICIENTS
    table: Ints  # [term] table row
    variable: Ints  # [term] index into VARIABLES
    factor: Ints  # [term] index into PARAMETERS: the dispersion that multiplies this term
