"""Rows of the lane memory ``Z[row, lane]``.

A single array with constant row numbers shows the compiler that rows do not overlap, so that it
vectorizes the loops over lanes.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc_vehicle.kernel.numerics.random_numbers import N_STREAM_ROWS
from abhv_mc_vehicle.kernel.plant.actuator_step import N_ACTUATOR_ROWS
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ALL_SENSORS,
    COEFFICIENTS,
    ENGINES,
    FIXED_TABLE_ROWS,
    MAX_ACTUATORS,
    PARAMETER_INDEX,
    PARAMETER_NAMES,
    SENSORS,
    VARIABLES,
)
from abhv_mc_vehicle.kernel.world.turbulence import N_FILTER_STATES

# The velocity is relative to the Earth, in body axes; body rates are inertial.
# The attitude quaternion describes the rotation from body to NED axes.
STATES = (
    "altitude",
    "longitude",
    "latitude",
    "u",
    "v",
    "w",
    "q0",
    "q1",
    "q2",
    "q3",
    "roll_rate",
    "pitch_rate",
    "yaw_rate",
    "mass",
    "aileron",
    "rudder",
    "elevator",
    "aileron_rate",
    "rudder_rate",
    "elevator_rate",
    "equivalence_ratio",
    "equivalence_ratio_rate",
)
N_STATES = len(STATES)
STATE_INDEX = {name: i for i, name in enumerate(STATES)}

ALTITUDE, LONGITUDE, LATITUDE, U, V, W, Q0, Q1, Q2, Q3 = range(10)
ROLL_RATE, PITCH_RATE, YAW_RATE, MASS, AILERON, RUDDER, ELEVATOR = range(10, 17)
AILERON_RATE, RUDDER_RATE, ELEVATOR_RATE, ETA, ETA_RATE = range(17, 22)

# Capacity of a lane; load_vehicle rejects larger vehicles. Unused capacity costs nothing.
MAX_TABLE_ROWS = 1024  # rows of tables and of their slopes over deflections, including padding
MAX_AXES = 64  # maximum number of different grids

# Contiguous blocks of the lane memory Z; each module defines the number of rows of its block.
# Unpacking a range into row names fails at import if their number is wrong.
X = 0  # state at the start of the step
XS = X + N_STATES  # state at the stage of the integrator
SUM = XS + N_STATES  # weighted sum of the stages' derivatives
P = SUM + N_STATES  # dispersed parameters
VAR = P + len(PARAMETER_NAMES)  # variables of the tables and of the build-up
COEF = VAR + len(VARIABLES)  # aerodynamic coefficients
CMD = COEF + len(COEFFICIENTS)  # commands held over the tick
AIR = CMD + 4  # air data of the stage
FIXED = AIR + 20  # engine and mass properties, in the order of FIXED_TABLE_ROWS
NAV = FIXED + len(FIXED_TABLE_ROWS)  # true motion relative to the Earth
MEASURED = NAV + 8  # measurement, the input of the control laws
N_MEASURED = len(SENSORS)
N_SEEN = len(ALL_SENSORS)  # number of measurements, including those for custom laws
COUNTED = MEASURED + N_SEEN  # 1 if metrics count the sample of the tick, else 0
COMMANDS = COUNTED + 1  # commands from the guidance to the attitude loop
GUST = (
    COMMANDS + 3
)  # gust and turbulence of the tick in body axes, density and temperature factors, knots of the air
TURBULENCE = GUST + 10  # state of the random stream, followed by the forming filters
FILTERS = TURBULENCE + N_STREAM_ROWS
PER_MASS_FACTOR = FILTERS + N_FILTER_STATES  # 1 / factor on the mass, constant during a flight
# coefficients of the surface and engine actuators, constant during a flight
ACTUATORS = PER_MASS_FACTOR + 1
# limits of the actuator being computed: lowest and highest position, rate limit, dead zone, half of
# the backlash, bandwidth
LIMITS = ACTUATORS + 2 * N_ACTUATOR_ROWS
AHEAD = LIMITS + 6  # actuator minus surface position within the backlash, for axes and engine
FAILURE = AHEAD + 4  # effects of failures at the tick, and states of failures
FOREIGN = (
    FAILURE + 20 + 4 * MAX_ACTUATORS + N_MEASURED
)  # arguments and results of custom functions of the vehicle
# direct commands to effectors by a control law, infinite if there is no command
EFFECTOR_COMMAND = FOREIGN + 23
# effectors with actuators: position, unlimited command, whether each or any is at its limit
EFFECTOR_AT, EFFECTOR_ASKED, EFFECTOR_SATURATED = (
    EFFECTOR_COMMAND + i * MAX_ACTUATORS for i in range(1, 4)
)
ANY_SATURATED = EFFECTOR_SATURATED + MAX_ACTUATORS
ENGINE_WHOLE = (
    ANY_SATURATED + 1
)  # thrust factors of all engines and of each engine; position of the remaining thrust
# custom dynamics: states, stage states, weighted rates, rates, motion, results and settings
MAX_STATES = 32  # maximum number of states of a vehicle's custom dynamics
MAX_SETTINGS = 128  # maximum number of settings of a vehicle's functions, including initial states
CUSTOM_STATE = ENGINE_WHOLE + 1 + len(ENGINES) + 3
CUSTOM_STAGE, CUSTOM_SUM, CUSTOM_RATE, MOTION = (CUSTOM_STATE + i * MAX_STATES for i in range(1, 5))
MOTION_ACCELERATION = MOTION + 11  # The acceleration follows velocity, attitude, rates and mass.
ANGULAR_ACCELERATION = MOTION_ACCELERATION + 3
GRAVITY = MOTION_ACCELERATION + 6
CUSTOM_FORCE = GRAVITY + 3
CUSTOM_MOMENT = GRAVITY + 6
SENSED = CUSTOM_MOMENT + 3  # additions to the measured quantities
SETTING = SENSED + N_SEEN
# Rows of the subpackages laws and flight follow, starting with the memory of the control law.
LAW = SETTING + MAX_SETTINGS

CMD_AILERON, CMD_RUDDER, CMD_ELEVATOR, CMD_ETA = range(CMD, AIR)

# air data: flow, latitude and Earth rotation, air velocity, specific force and thrust
_FLOW = AIR
_EARTH = AIR + 8
_AIR_VELOCITY = AIR + 13
_SPECIFIC_FORCE = AIR + 16
RHO, Q_BAR, AIRSPEED, SIN_ALPHA, COS_ALPHA, SIN_BETA, COS_BETA, OUTSIDE = range(_FLOW, _EARTH)
SIN_LAT, COS_LAT, EARTH_X, EARTH_Y, EARTH_Z = range(_EARTH, _AIR_VELOCITY)
AIR_U, AIR_V, AIR_W = range(_AIR_VELOCITY, _SPECIFIC_FORCE)
SPECIFIC_X, SPECIFIC_Y, SPECIFIC_Z, THRUST = range(_SPECIFIC_FORCE, FIXED)

CAPTURE, ISP, THRUST_AREA, INERTIA_XX, INERTIA_YY, INERTIA_ZZ, INERTIA_13, CG_X, CG_Z = range(
    FIXED, NAV
)
SPEED, GAMMA, CHI, BANK, NORTH, EAST, V_NORTH_LAST, V_EAST_LAST = range(NAV, MEASURED)
M_ALTITUDE, M_SPEED, M_GAMMA, M_CHI, M_ALPHA, M_BETA, M_BANK, M_P, M_Q, M_R = range(
    MEASURED, MEASURED + N_MEASURED
)
(
    M_AIRSPEED,
    M_MACH,
    M_LOAD_FACTOR,
    M_PITCH,
    M_ROLL,
    M_YAW,
    M_LATITUDE,
    M_LONGITUDE,
    M_NORTH,
    M_EAST,
) = range(MEASURED + N_MEASURED, COUNTED - 5)
M_EQUIVALENT_AIRSPEED = COUNTED - 5
M_CROSS_TRACK = COUNTED - 4
M_ACCELERATION = COUNTED - 3  # acceleration along x, y, z
GAMMA_CMD, ALPHA_CMD, BANK_CMD = range(COMMANDS, GUST)
GUST_U, GUST_V, GUST_W, DENSITY_PROFILE, GUST_P, GUST_Q, GUST_R, TEMPERATURE_PROFILE = range(
    GUST, GUST + 8
)
FIRST_KNOT = GUST + 8
INTERVALS = GUST + 9
# commands of the actuators; factors on rate and effectiveness of the three surfaces; failed engine:
# factor on thrust, increments of drag and pitching moment, whether it has failed; deflections of
# stuck surfaces; inlet: whether it is unstarted, and last time out of range; last time of a failed
# engine; gain, offset, stuck and slow deflections of effectors; frozen measurements
ACTUATED = FAILURE
RATE_FACTOR = FAILURE + 4
EFFECT = FAILURE + 7
ENGINE_THRUST, ENGINE_DRAG, ENGINE_PITCH, ENGINE_FAILED = range(FAILURE + 10, FAILURE + 14)
STUCK_SURFACE = FAILURE + 14
UNSTARTED = FAILURE + 17
UNSTART_TIME = FAILURE + 18
FAILED_TIME = FAILURE + 19
EFFECTOR_GAIN, EFFECTOR_OFFSET, STUCK_EFFECTOR, SLOW_EFFECTOR, FROZEN = (
    FAILURE + 20 + i * MAX_ACTUATORS for i in range(5)
)
ENGINE_RUNS = ENGINE_WHOLE + 1
ENGINE_ARM = ENGINE_WHOLE + 1 + len(ENGINES)

# custom functions: arguments, thrust and moment, fuel flow, coefficients, whether dispersed
F_DENSITY = FOREIGN
F_AIRSPEED = FOREIGN + 1
F_THRUST = FOREIGN + 2
F_MOMENT = FOREIGN + 5
F_FUEL_FLOW = FOREIGN + 8
F_COEF = FOREIGN + 9
F_BASE = FOREIGN + 15
F_MASS = FOREIGN + 21
F_DISPERSED = FOREIGN + 22

N_VARIABLES = len(VARIABLES)
N_COEFFICIENTS = len(COEFFICIENTS)
N_PARAMETERS = len(PARAMETER_NAMES)


def aligned_zeros(
    shape: tuple[int, ...] | int, dtype: type[np.generic] = np.float64
) -> NDArray[Any]:
    """Return zeros aligned to cache lines, which vectors of eight doubles do not cross."""
    line = 64  # length of a cache line, bytes
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + line, np.uint8)
    start = -memory.ctypes.data % line
    return memory[start : start + size].view(dtype).reshape(shape)


def parameter_row(name: str) -> int:
    """Return the row of a parameter in the lane memory."""
    return P + PARAMETER_INDEX[name]


def parameter_rows(first: str, count: int) -> range:
    """Return the rows of ``count`` parameters, starting with ``first``."""
    return range(parameter_row(first), parameter_row(first) + count)


def variable_row(name: str) -> int:
    """Return the row of a variable in the lane memory."""
    return VAR + VARIABLES.index(name)


# rows read by several modules: variables, and dispersions of mass, engine, actuators and air
V_ONE, V_MACH, V_ALPHA, V_BETA, V_P_HAT, V_Q_HAT, V_R_HAT, V_DELTA_A, V_DELTA_R, V_DELTA_E = range(
    VAR, VAR + 10
)
V_ETA, V_ALTITUDE, V_MASS, V_EFFECTOR = range(VAR + 10, VAR + 14)
K_MASS, K_XX, K_YY, K_ZZ, K_13, K_CG_X, K_CG_Y, K_CG_Z = parameter_rows("mass.total", 8)
K_THRUST, K_ISP = parameter_rows("propulsion.thrust", 2)
K_BANDWIDTH, K_DAMPING, K_LIMIT, K_RATE = parameter_rows("actuator.bandwidth", 4)
K_ENGINE_BANDWIDTH, K_ENGINE_DAMPING, K_ENGINE_RATE = parameter_rows("engine.bandwidth", 3)
K_DEAD_ZONE, _, K_ENGINE_DEAD_ZONE, _ = parameter_rows("actuator.dead_zone", 4)
K_DENSITY, K_WIND_NORTH, K_WIND_EAST, K_SHEAR_NORTH, K_SHEAR_EAST = parameter_rows(
    "atmosphere.density", 5
)
