"""Packed form of a vehicle: named tuples of arrays that the compiled plant reads.

They are arguments of the compiled code, not constants: one compiled flight serves every vehicle,
and a changed table never meets a stale cache.
"""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints

MAX_EFFECTORS = 16
MAX_ACTUATORS = MAX_EFFECTORS + 3  # including axes that the aerodynamics use directly
MAX_ENGINES = 4

# Variables of table axes and build-up terms, SI and radians. Effectors are surfaces of the vehicle,
# mixed from the three axis deflections.
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

# Lift and drag are in stability axes (from alpha), side force along body y; moments about body
# axes.
COEFFICIENTS = ("lift", "drag", "side_force", "rolling_moment", "pitching_moment", "yawing_moment")

# Quantities that the plant reads from every vehicle's tables: entry i is table row
# ``Tables.fixed_row[i]``, which is constant if the vehicle has no such table.
FIXED_TABLE_ROWS = (
    "capture_area_ratio",  # ca(Mach, alpha); 0 if the vehicle has a thrust area instead
    "specific_impulse",  # s
    "thrust_area",  # T / q_bar, m2; 0 if the vehicle has capture area and specific impulse
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
    """Look-up tables grouped by their axes, with a group contiguous at each node.

    Rows of the output are numbered 0..n_rows-1; a group fills ``group_width`` consecutive
    rows from ``group_row``. Node (i, j, k) of group g starts at
    ``data[group_start[g] + i*stride[g,0] + j*stride[g,1] + k*stride[g,2]]``.
    Every group has two or three dimensions: a 1-D table gets a second axis of stride 0.
    Constants are tables on the variable ``one`` (grid 0, 2), so they never leave the tables.
    """

    axis_variable: Ints  # [axis] index into VARIABLES
    axis_start: Ints  # [axis] first node in grid
    axis_length: Ints  # [axis] number of nodes, at least 2
    grid: Floats  # [node] concatenated axes, strictly increasing within an axis
    inverse_step: Floats  # [node] 1 / (grid[i + 1] - grid[i]); 0 at an axis's last node
    group_dimensions: Ints  # [group] 2 or 3
    group_axis: Ints  # [group, 3] axis index; an unused dimension has axis 0 with stride 0
    group_stride: Ints  # [group, 3]
    group_start: Ints  # [group]
    group_width: (
        Ints  # [group] a multiple of CHUNK, padded with zeros, so that vector loops have no rest
    )
    group_used: Ints  # [group] number of tables without padding
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
    """Reference of measured values: 1 relative to the air, 0 relative to the Earth."""

    angle_of_attack: int = 0
    sideslip: int = 0
    speed: int = 0


class LoadBounds(NamedTuple):
    """Greatest values in a flight, SI and radians; infinite without a limit."""

    dynamic_pressure: float = math.inf  # Pa
    load_factor: float = math.inf  # g
    heat_flux: float = math.inf  # W/m2
    bank: float = math.inf  # rad, to either side
    bank_ripple: float = math.inf  # rad, see abhv_mc.kernel.flight.ripple
    angle_of_attack_ripple: float = math.inf
    sideslip_ripple: float = math.inf


class Inlet(NamedTuple):
    """Range in which the inlet stays started, SI and radians, and increments of its unstart."""

    unstarts: float = 0.0  # 1 if the vehicle file has such a range
    angle_of_attack_min: float = -math.inf
    angle_of_attack_max: float = math.inf
    sideslip_max: float = math.inf
    mach_min: float = -math.inf
    mach_max: float = math.inf
    restart_delay: float = math.inf  # s inside the range until it restarts; infinite: never
    drag_increment: float = 0.0
    pitching_moment_increment: float = 0.0


class Foreign(NamedTuple):
    """Custom functions of the vehicle, whose code is identified by its digest."""

    aerodynamics: int  # 1 if they compute the coefficients
    propulsion: int  # 1 if they compute the thrust
    engine_x: float  # m, point of the thrust's moments, from the moment reference
    engine_z: float
    digest: Ints  # [4] SHA-256 of the code and its calling conventions; zeros without code
    settings: Floats  # [setting] of aerodynamics, propulsion and dynamics
    states: int  # number of custom states
    state_limit: Floats  # [state] greatest magnitude, above which a flight ends


def no_functions() -> Foreign:
    """Return the functions of a vehicle of tables, which has none."""
    return Foreign(0, 0, 0.0, 0.0, np.zeros(4, np.int64), np.zeros(0), 0, np.zeros(0))


class Constants(NamedTuple):
    """Constants of a vehicle, SI and radians."""

    area: float  # reference area, m2
    span: float  # reference span (roll and yaw), m
    chord: float  # reference chord (pitch), m
    # T = capture_thrust * eta * rho * V * ca * Isp: stoichiometric ratio * cowl area * g0
    capture_thrust: float
    standard_gravity: float  # g0 of the specific impulse, m/s2: fuel flow = T / (g0 Isp)
    thrust_cos: float  # cosine and sine of the thrust line's upward inclination
    thrust_sin: float
    thrust_offset_z: float  # thrust line below the moment reference, m
    mass_start: float  # kg
    mass_empty: float  # kg: no fuel below it
    burns_fuel: float  # 1, or 0 without an empty mass: the mass is constant and the engine runs
    surface_limit: float  # rad, greatest axis deflection that a law commands
    equivalence_ratio_min: float  # least and greatest throttle
    equivalence_ratio_max: float
    angle_of_attack_min: float  # rad, a flight ends outside
    angle_of_attack_max: float
    sideslip_max: float
    # 1: drag opposes the velocity (a sphere); 0: drag and lift in stability axes
    drag_in_wind_axes: float
    nose_radius: float  # m; 0 if the file has none
    inlet: Inlet
    bounds: LoadBounds  # a flight ends above
    relight_delay: float = 0.0  # s from the end of an engine's failure until it starts to recover
    relight_time_constant: float = 0.0  # s, of the recovery; 0: the lag of the engine
    sensing: Sensing = Sensing()  # reference of measured angles and speed
    driven: float = 0.0  # 1: effectors have actuators; 0: the three axes have, and effectors follow


class Effectors(NamedTuple):
    """Effectors with actuators: those of the file, then axes that the aerodynamics use."""

    variable: Ints  # [effector] index into VARIABLES of its deflection
    mix: Floats  # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    share: Floats  # [axis, effector, effector] projection of deflections onto an axis, within a set
    axes: Floats  # [axis, effector] pseudo-inverse of the mix, from effectors to axes


class Vehicle(NamedTuple):
    """Packed vehicle."""

    constants: Constants
    tables: Tables
    build_up: BuildUp
    # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    effector_mix: Floats
    effectors: Effectors
    # [actuator, column of actuator_step] aileron, rudder, elevator, engine, then the effectors
    actuators: Floats
    effector_names: Ints  # [effector, letter] code points, padded with zeros
    # [engine, 4] share of the thrust; x, y, z from the thrust line, m; none: one engine
    engines: Floats
    foreign: Foreign = no_functions()
