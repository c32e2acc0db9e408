"""The packed form of a vehicle: plain arrays that the compiled plant reads.

A vehicle file (any tables, any build-up) is turned once into these named tuples.
They are arguments of the compiled code, not constants of it: one compiled flight
serves every vehicle, and a changed table can never meet a stale cache.
"""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints

MAX_EFFECTORS = 16  # surfaces of a vehicle's own
MAX_ACTUATORS = MAX_EFFECTORS + 3  # with the axes that the aerodynamics name themselves
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


class Sensing(NamedTuple):
    """Which of the measured values are relative to the air: 1, or 0 where to the Earth."""

    angle_of_attack: int = 0
    sideslip: int = 0
    speed: int = 0


class LoadBounds(NamedTuple):
    """Greatest values in a flight, SI and radians; infinite where there is no limit."""

    dynamic_pressure: float = math.inf  # Pa
    load_factor: float = math.inf  # g
    heat_flux: float = math.inf  # W/m2
    bank: float = math.inf  # rad, to either side
    bank_ripple: float = math.inf  # rad, see abhv_mc.kernel.flight.ripple
    angle_of_attack_ripple: float = math.inf
    sideslip_ripple: float = math.inf


class Inlet(NamedTuple):
    """Where the inlet stays started, SI and radians, and what its unstart does besides the loss of thrust."""

    unstarts: float = 0.0  # 1 where the vehicle file has such a range
    angle_of_attack_min: float = -math.inf
    angle_of_attack_max: float = math.inf
    sideslip_max: float = math.inf
    mach_min: float = -math.inf
    mach_max: float = math.inf
    restart_delay: float = math.inf  # s inside the range until it starts again; infinite: never
    drag_increment: float = 0.0
    pitching_moment_increment: float = 0.0


class Foreign(NamedTuple):
    """Functions of the vehicle's own; their code is known by its digest."""

    aerodynamics: int  # 1 where they give the coefficients
    propulsion: int  # 1 where they give the thrust
    engine_x: float  # m, where the thrust's moments are given, from the moment reference
    engine_z: float
    digest: Ints  # [4] SHA-256 of the code and of how it is called; zeros without code
    settings: Floats  # [setting] of aerodynamics, propulsion and dynamics, one after another
    states: int  # of custom dynamics
    state_limit: Floats  # [state] greatest value to either side; a flight ends above


def no_functions() -> Foreign:
    """A vehicle of tables."""
    return Foreign(0, 0, 0.0, 0.0, np.zeros(4, np.int64), np.zeros(0), 0, np.zeros(0))


class Constants(NamedTuple):
    """Numbers of a vehicle, SI and radians."""

    area: float  # reference area, m2
    span: float  # reference span (roll and yaw), m
    chord: float  # reference chord (pitch), m
    capture_thrust: float  # T = capture_thrust * eta * rho * V * ca * Isp: stoichiometric ratio * cowl area * g0
    standard_gravity: float  # g0 of the specific impulse, m/s2: fuel flow = T / (g0 Isp)
    thrust_cos: float  # cosine and sine of the thrust line's upward inclination
    thrust_sin: float
    thrust_offset_z: float  # thrust line below the moment reference, m
    mass_start: float  # kg
    mass_empty: float  # kg: no fuel below it
    burns_fuel: float  # 1, or 0 for a vehicle whose file gives no empty mass: its mass stays and its engine runs
    surface_limit: float  # rad, greatest axis deflection that a law commands
    equivalence_ratio_min: float  # least and greatest throttle
    equivalence_ratio_max: float
    angle_of_attack_min: float  # rad, a flight ends outside
    angle_of_attack_max: float
    sideslip_max: float
    drag_in_wind_axes: (
        float  # 1: drag opposes the velocity (a sphere); 0: drag and lift in stability axes
    )
    nose_radius: float  # m; 0 where the file has none
    inlet: Inlet
    bounds: LoadBounds  # a flight ends above
    relight_delay: float = 0.0  # s from the end of an engine's failure until it begins to come back
    relight_time_constant: float = 0.0  # s, with which it comes back; 0: the engine's own lag
    sensing: Sensing = Sensing()  # what angles and speed are measured against
    driven: float = (
        0.0  # 1: effectors have actuators; 0: the three axes have, which effectors follow
    )


class Effectors(NamedTuple):
    """Where effectors have actuators: those of the file, then each axis that the aerodynamics name."""

    variable: Ints  # [effector] index into VARIABLES of its deflection
    mix: Floats  # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    share: Floats  # [axis, effector, effector] an axis' part of deflections, from those of the same set
    axes: Floats  # [axis, effector] pseudo-inverse of the mix: the axes' deflections of the effectors'


class Vehicle(NamedTuple):
    """The packed vehicle."""

    constants: Constants
    tables: Tables
    build_up: BuildUp
    effector_mix: (
        Floats  # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    )
    effectors: Effectors
    # [actuator, column of actuator_step] aileron, rudder, elevator, engine, then each of the effectors
    actuators: Floats
    effector_names: Ints  # [effector, letter] code points, zeros behind
    engines: Floats  # [engine, 4] share of the thrust; x, y, z of it from where all of it acts, m; none: one engine
    foreign: Foreign = no_functions()
