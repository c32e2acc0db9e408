"""Packed form of a vehicle for the compiled plant, and names of all dispersible parameters.

The names are in the order of a flight's parameters.

The tuples are arguments of the kernels, not constants, so one compiled kernel simulates any vehicle
and changed tables need no compilation.

The parameters are described in :mod:`abhv_mc_vehicle.plant.parameters`. New parameters are
appended, because the position here is the dimension of a Sobol or Halton sequence and must not
change. Related parameters may therefore be in several blocks; the kernel finds each block by the
name of its first parameter.
"""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints

MAX_EFFECTORS = 16
# maximum number of actuators, including axes that the aerodynamics use directly
MAX_ACTUATORS = MAX_EFFECTORS + 3
MAX_ENGINES = 4

# Variables of table axes and build-up terms, in SI units and radians.
# Effectors are surfaces of the vehicle, mixed from the three axis deflections.
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

# Lift and drag are in stability axes, the side force is along body y, moments about body axes.
COEFFICIENTS = ("lift", "drag", "side_force", "rolling_moment", "pitching_moment", "yawing_moment")

# Quantities that every vehicle has. Entry i is in table row ``Tables.fixed_row[i]``, which is
# constant if the vehicle file has no table for it.
FIXED_TABLE_ROWS = (
    "capture_area_ratio",  # ca(Mach, alpha); 0 if the vehicle has a thrust area instead
    "specific_impulse",  # specific impulse, s
    "thrust_area",  # T / q_bar, m2; 0 if the vehicle has capture area and specific impulse
    "inertia_xx",  # moment of inertia, kg m2
    "inertia_yy",
    "inertia_zz",
    "inertia_13",  # matrix element 13, positive for GHAME
    "center_of_gravity_x",  # distance of the centre of gravity forward of the moment reference, m
    "center_of_gravity_z",  # distance of the centre of gravity below the moment reference, m
)

MAX_DIMENSIONS = 3
CHUNK = 8  # number of doubles in one AVX-512 register or two AVX2 registers


class Tables(NamedTuple):
    """Look-up tables grouped by their axes; at each node, a group's values are contiguous.

    Rows of the output are numbered 0..n_rows-1; a group fills ``group_width`` consecutive
    rows from ``group_row``. Node (i, j, k) of group g starts at
    ``data[group_start[g] + i*stride[g,0] + j*stride[g,1] + k*stride[g,2]]``.
    Every group has two or three dimensions: a 1-D table gets a second axis of stride 0.
    Constants are tables over the variable ``one`` (grid 0, 2), which never leaves the grid.
    """

    axis_variable: Ints  # [axis] index of the variable in VARIABLES
    axis_start: Ints  # [axis] first node in ``grid``
    axis_length: Ints  # [axis] number of nodes, at least 2
    grid: Floats  # [node] nodes of all axes, strictly increasing within an axis
    inverse_step: Floats  # [node] 1 / (grid[i + 1] - grid[i]); 0 at the last node of an axis
    group_dimensions: Ints  # [group] number of dimensions, 2 or 3
    group_axis: Ints  # [group, 3] axis index; an unused dimension has axis 0 with stride 0
    group_stride: Ints  # [group, 3] stride in ``data``
    group_start: Ints  # [group] start in ``data``
    group_width: (
        Ints  # [group] multiple of CHUNK, padded with zeros for vector loops without a remainder
    )
    group_used: Ints  # [group] number of tables, without padding
    group_row: Ints  # [group] first output row
    data: Floats  # values of all tables
    fixed_row: Ints  # [entry] table row of each of FIXED_TABLE_ROWS
    n_rows: int  # number of output rows


class BuildUp(NamedTuple):
    """Build-up of coefficients as a sum of factor * table * variable over terms."""

    coefficient: Ints  # [term] index of the coefficient in COEFFICIENTS
    table: Ints  # [term] table row
    variable: Ints  # [term] index of the variable in VARIABLES
    factor: Ints  # [term] index in PARAMETERS of the dispersion that multiplies the term


class Sensing(NamedTuple):
    """Reference of measured values: 1 for the air, 0 for the Earth."""

    angle_of_attack: int = 0
    sideslip: int = 0
    speed: int = 0


class LoadBounds(NamedTuple):
    """Largest allowed values in a flight, in SI units and radians; infinite if unlimited."""

    dynamic_pressure: float = math.inf  # maximum dynamic pressure, Pa
    load_factor: float = math.inf  # maximum load factor, g
    heat_flux: float = math.inf  # maximum heat flux, W/m2
    bank: float = math.inf  # maximum bank to either side, rad
    # maximum ripple of the bank, rad, see abhv_mc_vehicle.kernel.flight.ripple
    bank_ripple: float = math.inf
    angle_of_attack_ripple: float = math.inf
    sideslip_ripple: float = math.inf


class Envelope(NamedTuple):
    """Altitudes (m) and Mach numbers outside which a flight ends."""

    altitude_min: float = -math.inf
    altitude_max: float = math.inf
    mach_min: float = -math.inf
    mach_max: float = math.inf


class Inlet(NamedTuple):
    """Flow conditions of a started inlet, and effects of an unstart, SI units and radians."""

    unstarts: float = 0.0  # 1 if the vehicle file limits the flow of a started inlet, else 0
    angle_of_attack_min: float = -math.inf
    angle_of_attack_max: float = math.inf
    sideslip_max: float = math.inf
    mach_min: float = -math.inf
    mach_max: float = math.inf
    # time inside the range until the inlet restarts, s; infinite if it never restarts
    restart_delay: float = math.inf
    drag_increment: float = 0.0
    pitching_moment_increment: float = 0.0


class Foreign(NamedTuple):
    """Custom functions of the vehicle, whose code is identified by a digest."""

    aerodynamics: int  # 1 if custom functions compute the coefficients
    propulsion: int  # 1 if custom functions compute the thrust
    engine_x: float  # reference point of the thrust's moments, m from the moment reference
    engine_z: float
    digest: Ints  # [4] SHA-256 of the code and its calling conventions; zeros without code
    settings: Floats  # [setting] settings of aerodynamics, propulsion and dynamics
    states: int  # number of custom states
    state_limit: Floats  # [state] largest magnitude, beyond which a flight ends


def no_functions() -> Foreign:
    """Return the record of a vehicle defined by tables, which has no custom functions."""
    return Foreign(0, 0, 0.0, 0.0, np.zeros(4, np.int64), np.zeros(0), 0, np.zeros(0))


class Constants(NamedTuple):
    """Constants of a vehicle, in SI units and radians."""

    area: float  # reference area, m2
    span: float  # reference span (roll and yaw), m
    chord: float  # reference chord (pitch), m
    # stoichiometric ratio * cowl area * g0, so that T = capture_thrust * eta * rho * V * ca * Isp
    capture_thrust: float
    standard_gravity: float  # g0 of the specific impulse, m/s2: fuel flow = T / (g0 Isp)
    thrust_cos: float  # cosine and sine of the upward inclination of the thrust line
    thrust_sin: float
    thrust_offset_z: float  # distance of the thrust line below the moment reference, m
    mass_start: float  # initial mass, kg
    mass_empty: float  # mass without fuel, kg
    burns_fuel: float  # 1, or 0 if mass is constant and the engine always runs
    surface_limit: float  # largest axis deflection that a control law commands, rad
    equivalence_ratio_min: float  # minimum and maximum throttle
    equivalence_ratio_max: float
    angle_of_attack_min: float  # A flight ends outside this range of the angle of attack, rad.
    angle_of_attack_max: float
    sideslip_max: float
    # 1 if drag opposes the velocity (as for a sphere), 0 if drag and lift are in stability axes
    drag_in_wind_axes: float
    nose_radius: float  # nose radius, m; 0 if the vehicle file has none
    inlet: Inlet
    bounds: LoadBounds  # limits beyond which a flight ends
    # delay from the end of an engine's failure to the start of its recovery, s
    relight_delay: float = 0.0
    relight_time_constant: float = 0.0  # time constant of recovery, s; if 0, the engine's lag
    sensing: Sensing = Sensing()  # reference for the measured angles and speed
    # 1 if the effectors have actuators; 0 if the three axes have actuators and effectors follow
    driven: float = 0.0
    envelope: Envelope = Envelope()


class Effectors(NamedTuple):
    """Effectors with actuators: effectors of the vehicle file, then axes used by aerodynamics."""

    variable: Ints  # [effector] index in VARIABLES of its deflection
    mix: Floats  # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    share: Floats  # [axis, effector, effector] projection onto each axis (vehicle.actuators)
    axes: Floats  # [axis, effector] pseudo-inverse of the mix, which maps effectors to axes


class Vehicle(NamedTuple):
    """Vehicle in packed form, as an argument of the kernels."""

    constants: Constants
    tables: Tables
    build_up: BuildUp
    # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    effector_mix: Floats
    effectors: Effectors
    # [actuator, column of actuator_step] aileron, rudder, elevator, engine, effectors
    actuators: Floats
    effector_names: Ints  # [effector, letter] Unicode code points, padded with zeros
    # [engine, 4] share of the thrust, and x, y, z from the thrust line, m; empty for one engine
    engines: Floats
    foreign: Foreign = no_functions()


MEMBER = "atmosphere.member"
NEVER = math.inf  # time of a failure that does not occur
DENSITY_KNOTS_KM = (10, 15, 20, 25, 30, 35, 40)

# Components that may fail: axes, effectors and engines (numbered), and sensors.
AXES = ("aileron", "rudder", "elevator")
EFFECTORS = tuple(f"effector_{i}" for i in range(MAX_EFFECTORS))
ENGINES = tuple(f"engine_{i}" for i in range(MAX_ENGINES))
SENSORS = (
    *("altitude", "speed", "flight_path_angle", "heading", "angle_of_attack", "sideslip", "bank"),
    *("roll_rate", "pitch_rate", "yaw_rate"),
)
# Additional measurements for custom control laws, whose errors are in a separate block.
MORE_SENSORS = (
    *(
        "airspeed",
        "mach",
        "load_factor",
        "pitch",
        "roll",
        "yaw",
        "latitude",
        "longitude",
        "north",
        "east",
    ),
    *("equivalent_airspeed", "cross_track"),
)
ACCELERATIONS = ("acceleration_x", "acceleration_y", "acceleration_z")  # specific force, body axes
_EARLIER_SENSORS = (*SENSORS, *MORE_SENSORS)
ALL_SENSORS = (*_EARLIER_SENSORS, *ACCELERATIONS)
UNSCALED_SENSORS = (
    "flight_path_angle",
    "heading",
    "bank",
    "pitch",
    "roll",
    "yaw",
    "latitude",
    "longitude",
)
SCALED_SENSORS = tuple(name for name in ALL_SENSORS if name not in UNSCALED_SENSORS)
SENSOR_NOISES = tuple(f"sensor.{name}_noise" for name in ALL_SENSORS)
_RATES = ("roll_rate", "pitch_rate", "yaw_rate")
_GUST_AXES = ("forward", "right", "down")
_FIRST = (*AXES, *EFFECTORS[:4])  # components in the first block of failures
_MORE = EFFECTORS[4:]


def _failure_names(first: tuple[str, ...], then: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"failure.{name}.{what}" for name in first for what in then)


_TIMES = ("stuck_time", "loss_time", "slow_time")
_MODES = ("stuck_at", "effectiveness", "rate_limit")

PARAMETER_NAMES: tuple[str, ...] = (
    *(
        "one",
        "atmosphere.density",
        "wind.north",
        "wind.east",
        "wind.shear_north",
        "wind.shear_east",
    ),
    *(f"aero.{name}" for name in COEFFICIENTS),
    *(f"aero.{name}.increment" for name in ("lift", "drag", "pitching_moment")),
    *(
        f"aero.{name}.{variable}"
        for name in COEFFICIENTS
        for variable in ("sideslip", *_RATES, *AXES)
    ),
    *(f"control.{name}_effectiveness" for name in AXES),
    *(f"propulsion.{name}" for name in ("thrust", "specific_impulse")),
    *(f"mass.{name}" for name in ("total", "inertia_xx", "inertia_yy", "inertia_zz", "inertia_13")),
    *(f"mass.center_of_gravity_{axis}" for axis in "xyz"),
    *(f"actuator.{name}" for name in ("bandwidth", "damping", "deflection_limit", "rate_limit")),
    *(f"engine.{name}" for name in ("bandwidth", "damping", "rate_limit")),
    *(f"initial.{name}" for name in SENSORS),
    *(f"sensor.{name}_bias" for name in SENSORS),
    "engine.equivalence_ratio_limit",
    *(f"atmosphere.density_at_{km}km" for km in DENSITY_KNOTS_KM),
    *(f"wind.gust_{name}" for name in ("north", "east", "down", "start", "length")),
    *("wind.turbulence", "wind.turbulence_length", "wind.turbulence_seed"),
    *SENSOR_NOISES[: len(SENSORS)],
    *("sensor.noise_seed", "sensor.delay"),
    # All failure times are contiguous, so that one search finds any finite time.
    *_failure_names(_FIRST, _TIMES),
    "failure.engine.time",
    *(f"failure.sensor.{name}.time" for name in SENSORS),
    *_failure_names(_FIRST, _MODES),
    *_failure_names(
        ("engine",), ("duration", "thrust", "drag_increment", "pitching_moment_increment")
    ),
    *(f"failure.sensor.{name}.bias" for name in SENSORS),
    *(f"wind.turbulence_{axis}" for axis in _GUST_AXES),
    *(f"wind.turbulence_length_{axis}" for axis in _GUST_AXES),
    "wind.turbulence_rotary",
    *_failure_names(_MORE, _TIMES),
    *_failure_names(ENGINES, ("time",)),
    *_failure_names(_MORE, _MODES),
    *_failure_names(ENGINES, ("duration",)),
    *_failure_names(ENGINES, ("thrust",)),
    *(f"control.{name}_effectiveness" for name in EFFECTORS),
    *(f"sensor.{name}_bias" for name in MORE_SENSORS),
    *SENSOR_NOISES[len(SENSORS) : len(_EARLIER_SENSORS)],
    *(f"sensor.{name}_lag" for name in _EARLIER_SENSORS),
    *(f"sensor.{name}_interval" for name in _EARLIER_SENSORS),
    *(f"sensor.{name}_scale" for name in SCALED_SENSORS if name not in ACCELERATIONS),
    *(
        f"sensor.{name}_{error}"
        for error in ("bias", "noise", "lag", "interval", "scale")
        for name in ACCELERATIONS
    ),
    *(
        f"{device}.{slack}"
        for device in ("actuator", "engine")
        for slack in ("dead_zone", "backlash")
    ),
    *("thrust.inclination", "thrust.azimuth"),
    *("atmosphere.temperature", "atmosphere.uniform_temperature_offset"),
    MEMBER,
)
FAILURE_TIMES = tuple(
    name for name in PARAMETER_NAMES if name.startswith("failure.") and name.endswith("time")
)
PARAMETER_INDEX: dict[str, int] = {name: i for i, name in enumerate(PARAMETER_NAMES)}
