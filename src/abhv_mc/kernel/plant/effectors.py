"""The vehicle's own surfaces: mixed from the three axis deflections, or each moved by an actuator of its own.

What actuators of effectors need has a memory of its own, ``A[row, lane]``: vehicles without them never touch it.
"""

import math

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.numerics.angles import clamp, smaller
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.actuator_step import N_ACTUATOR_ROWS
from abhv_mc.kernel.plant.actuators import Actuator, prepare_actuator, run_actuator
from abhv_mc.kernel.plant.disturbance import any_lane
from abhv_mc.kernel.plant.state import XS, X, parameter_row, variable_row
from abhv_mc.kernel.plant.vehicle import BANDWIDTH, DAMPING, DRIVEN, HIGH, IDEAL, LOW, MAX_EFFECTORS, RATE

# Rows of an effector: position, rate, the position of the stages, both after the step, its command, the factor on its
# rate limit; then what its actuator needs.
POSITION, MOVES, STAGE, NEXT, NEXT_RATE, COMMAND, SLOWED, BLOCK = range(8)
N_EFFECTOR_ROWS = BLOCK + N_ACTUATOR_ROWS
A_ROWS = MAX_EFFECTORS * N_EFFECTOR_ROWS

_EFFECTOR = variable_row("effector_0")
_DELTA = variable_row("aileron")  # then rudder and elevator
_K_BANDWIDTH = parameter_row("actuator.bandwidth")
_K_DAMPING = parameter_row("actuator.damping")
_K_LIMIT = parameter_row("actuator.deflection_limit")
_K_RATE = parameter_row("actuator.rate_limit")


@lanes
def any_driven(vehicle):
    """Whether an effector has an actuator of its own."""
    driven = False
    for e in range(vehicle.effectors.shape[0]):
        driven |= vehicle.effectors[e, DRIVEN] > 0.0
    return driven


@lanes
def set_effectors(Z, width, mix):
    """Effectors that follow the three (effective) axis deflections."""
    for e in range(mix.shape[0]):
        aileron, rudder, elevator = mix[e, 0], mix[e, 1], mix[e, 2]
        for lane in range(width):
            Z[_EFFECTOR + e, lane] = (
                aileron * Z[_DELTA, lane] + rudder * Z[_DELTA + 1, lane] + elevator * Z[_DELTA + 2, lane]
            )


@lanes
def place_effectors(Z, A, width, vehicle, failing, without):
    """Deflections of the stage, from the axes' (effective) deflections among the variables and from the actuators.

    ``failing``: an effector of some flight fails, see :mod:`abhv_mc.kernel.plant.failures`. ``without``: the axis whose
    part is left out, -1 for none; its deflection among the variables is 0 then.
    """
    mix = vehicle.effector_mix
    set_effectors(Z, width, mix)
    for e in range(mix.shape[0]):
        if vehicle.effectors[e, DRIVEN] > 0.0:
            stage = e * N_EFFECTOR_ROWS + STAGE
            for lane in range(width):
                Z[_EFFECTOR + e, lane] = A[stage, lane]
            for i in range(3):
                if i == without or any_lane(Z, width, s.EFFECT + i, 1, 1.0):
                    weaken_effector(Z, A, width, vehicle, e, i, without)
    if failing:
        for e in range(mix.shape[0]):
            for lane in range(width):
                mixed = Z[_EFFECTOR + e, lane]
                Z[_EFFECTOR + e, lane] = Z[s.EFFECTOR_GAIN + e, lane] * mixed + Z[s.EFFECTOR_OFFSET + e, lane]


@lanes
def weaken_effector(Z, A, width, vehicle, e, i, without):
    """Less of the axis' part of an effector, which the positions of its set make."""
    share, mix = vehicle.effector_share, vehicle.effector_mix
    for f in range(mix.shape[0]):
        if share[i, e, f] != 0.0:
            driven = vehicle.effectors[f, DRIVEN] > 0.0
            for lane in range(width):
                mixed = 0.0
                for axis in range(3):
                    mixed += mix[f, axis] * Z[XS + s.AILERON + axis, lane]
                position = A[f * N_EFFECTOR_ROWS + STAGE, lane] if driven else mixed
                kept = 0.0 if i == without else Z[s.EFFECT + i, lane]
                Z[_EFFECTOR + e, lane] += (kept - 1.0) * (share[i, e, f] * position)


@lanes
def leave_effectors(Z, width, effectors):
    """No law commands them."""
    for e in range(effectors.shape[0]):
        for lane in range(width):
            Z[s.EFFECTOR_COMMAND + e, lane] = math.inf


@lanes
def start_effectors(Z, A, width, vehicle, step):
    """Effectors where the axes' deflections at the start put them, at rest."""
    effectors = vehicle.effectors
    for e in range(effectors.shape[0]):
        first = e * N_EFFECTOR_ROWS
        if effectors[e, DRIVEN] > 0.0:
            for lane in range(width):
                bandwidth = effectors[e, BANDWIDTH] * Z[_K_BANDWIDTH, lane]
                damping = effectors[e, DAMPING] * Z[_K_DAMPING, lane]
                prepare_actuator(A, lane, first + BLOCK, bandwidth, damping, step)
                mixed = 0.0
                for i in range(3):
                    mixed += vehicle.effector_mix[e, i] * Z[X + s.AILERON + i, lane]
                factor = Z[_K_LIMIT, lane]
                mixed = clamp(mixed, effectors[e, LOW] * factor, effectors[e, HIGH] * factor)
                A[first + POSITION, lane], A[first + STAGE, lane] = mixed, mixed
                A[first + MOVES, lane] = 0.0


@lanes
def command_effectors(Z, A, width, vehicle):
    """Commands of the tick: what the law gives an effector, else the mix of the axes', within its limits.

    What an axis' failure does to its rate it does to the effectors that it moves.
    """
    effectors, mix = vehicle.effectors, vehicle.effector_mix
    for lane in range(width):
        Z[s.EFFECTOR_AT_LIMIT, lane] = 0.0
    for e in range(effectors.shape[0]):
        if effectors[e, DRIVEN] > 0.0:
            first = e * N_EFFECTOR_ROWS
            for lane in range(width):
                mixed, slowed = 0.0, 1.0
                for i in range(3):
                    mixed += mix[e, i] * Z[s.ACTUATED + i, lane]
                    slowed = smaller(slowed, Z[s.RATE_FACTOR + i, lane] if mix[e, i] != 0.0 else 1.0)
                given = Z[s.EFFECTOR_COMMAND + e, lane]
                asked = mixed if given == math.inf else given
                factor = Z[_K_LIMIT, lane]
                low, high = effectors[e, LOW] * factor, effectors[e, HIGH] * factor
                at_limit = asked < low or asked > high
                Z[s.EFFECTOR_AT_LIMIT, lane] = 1.0 if at_limit else Z[s.EFFECTOR_AT_LIMIT, lane]
                A[first + COMMAND, lane], A[first + SLOWED, lane] = clamp(asked, low, high), slowed


@lanes
def move_ideal_effectors(A, width, effectors):
    """Effectors without dynamics are where they are commanded, from the tick's start."""
    for e in range(effectors.shape[0]):
        if effectors[e, DRIVEN] > 0.0 and effectors[e, IDEAL] > 0.0:
            first = e * N_EFFECTOR_ROWS
            for lane in range(width):
                A[first + POSITION, lane], A[first + STAGE, lane] = A[first + COMMAND, lane], A[first + COMMAND, lane]


@lanes
def run_effectors(Z, A, width, vehicle, step):
    """Effectors with actuators of their own through a step, after its first stage."""
    effectors = vehicle.effectors
    low, high, rate_limit = Z[s.LIMITS], Z[s.LIMITS + 1], Z[s.LIMITS + 2]
    for e in range(effectors.shape[0]):
        first = e * N_EFFECTOR_ROWS
        if effectors[e, DRIVEN] > 0.0 and effectors[e, IDEAL] > 0.0:
            for lane in range(width):
                A[first + NEXT, lane], A[first + NEXT_RATE, lane] = A[first + POSITION, lane], 0.0
        elif effectors[e, DRIVEN] > 0.0:
            for lane in range(width):
                factor = Z[_K_LIMIT, lane]
                low[lane], high[lane] = effectors[e, LOW] * factor, effectors[e, HIGH] * factor
                rate_limit[lane] = effectors[e, RATE] * Z[_K_RATE, lane] * A[first + SLOWED, lane]
            rows = Actuator(
                first + POSITION,
                first + MOVES,
                first + STAGE,
                first + NEXT,
                first + NEXT_RATE,
                first + COMMAND,
                first + BLOCK,
            )
            run_actuator(A, width, rows, low, high, rate_limit, step, False)


@lanes
def end_effectors(A, width, effectors):
    """Their positions at the end of the step, for its last stage."""
    for e in range(effectors.shape[0]):
        first = e * N_EFFECTOR_ROWS
        if effectors[e, DRIVEN] > 0.0:
            for lane in range(width):
                A[first + STAGE, lane] = A[first + NEXT, lane]


@lanes
def finish_effectors(A, width, effectors, alive):
    """Their state after the step. A flight that has ended (``alive`` 0) keeps its own."""
    for e in range(effectors.shape[0]):
        first = e * N_EFFECTOR_ROWS
        if effectors[e, DRIVEN] > 0.0:
            for lane in range(width):
                flies = alive[lane] > 0.0
                A[first + POSITION, lane] = A[first + NEXT, lane] if flies else A[first + POSITION, lane]
                A[first + MOVES, lane] = A[first + NEXT_RATE, lane] if flies else A[first + MOVES, lane]
                A[first + STAGE, lane] = A[first + POSITION, lane]
