"""Integration step of all actuators, in all lanes.

The list of actuators contains those of the three axes, the engine and the effectors, in this order.
Actuators depend only on their commands, which are constant over a tick, and are therefore computed
before the equations of motion. Actuators of axes and engine have rows in the memory ``Z``;
actuators of effectors (:mod:`abhv_mc_vehicle.kernel.plant.effectors`) have a separate memory.
Functions receive one of these two memories as ``M``.
"""

from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes, routine, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, exp
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import (
    AXES,
    BACKLASH,
    BANDWIDTH,
    DAMPING,
    DEAD_ZONE,
    END,
    ENGINE,
    FIRST_EFFECTOR,
    FIRST_ORDER,
    FRICTION,
    HIGH,
    IDEAL,
    KIND,
    LOW,
    MIDDLE,
    N_ACTUATOR_ROWS,
    RATE_LIMIT,
    REACH,
    SHORT,
    STIFFNESS,
    SUBSTEPS,
    Response,
    follow,
    short_step,
    slack_step,
    transition,
    turning_point,
)
from abhv_mc_vehicle.kernel.plant.state import SUM, XS, X, parameter_row

_K_ETA_LIMIT = parameter_row("engine.equivalence_ratio_limit")

# Rows of an effector with an actuator. NEXT and NEXT_RATE are position and rate after the step.
# AHEAD is the actuator's lead within its backlash. BLOCK is the first row of the coefficients from
# :func:`prepare_actuator`.
POSITION, MOVES, STAGE, NEXT, NEXT_RATE, COMMAND, SLOWED, AHEAD, BLOCK = range(9)
N_EFFECTOR_ROWS = BLOCK + N_ACTUATOR_ROWS


@lanes
def pass_commands(Z, width):
    """Copy the controller's commands to the actuators."""
    for i in range(4):
        for lane in range(width):
            Z[s.ACTUATED + i, lane] = Z[s.CMD + i, lane]


class Actuator(NamedTuple):
    """Row numbers of the values of one actuator in its memory.

    ``position`` and ``rate`` are values before the step, ``end`` and ``end_rate`` after it;
    ``middle`` is the position at the middle stages.
    """

    position: int
    rate: int
    middle: int
    end: int
    end_rate: int
    command: int
    slowed: int  # factor on the rate limit; not used for the engine
    ahead: int  # actuator minus surface position, at most half the backlash
    block: int  # first row of the coefficients from prepare_actuator


@scalar
def actuator_rows(i):
    """Return the row numbers of actuator ``i``.

    The three axes have the same actuator and share a block.
    """
    if i >= FIRST_EFFECTOR:
        first = (i - FIRST_EFFECTOR) * N_EFFECTOR_ROWS
        return Actuator(
            position=first + POSITION,
            rate=first + MOVES,
            middle=first + STAGE,
            end=first + NEXT,
            end_rate=first + NEXT_RATE,
            command=first + COMMAND,
            slowed=first + SLOWED,
            ahead=first + AHEAD,
            block=first + BLOCK,
        )
    position = s.AILERON + i
    rate = s.AILERON_RATE + i
    block = s.ACTUATORS
    if i == ENGINE:
        position = s.ETA
        rate = s.ETA_RATE
        block = s.ACTUATORS + N_ACTUATOR_ROWS
    return Actuator(
        position=X + position,
        rate=X + rate,
        middle=XS + position,
        end=SUM + position,
        end_rate=SUM + rate,
        command=s.ACTUATED + i,
        slowed=s.RATE_FACTOR + i,
        ahead=s.AHEAD + i,
        block=block,
    )


@lanes
def limits_of(Z, lane, actuators, i):
    """Return an actuator's lowest and highest positions; axes have symmetric limits."""
    if i == ENGINE:
        return actuators[i, LOW], actuators[i, HIGH] * Z[_K_ETA_LIMIT, lane]
    if i < AXES:
        limit = actuators[i, HIGH] * Z[s.K_LIMIT, lane]
        return -limit, limit
    return actuators[i, LOW] * Z[s.K_LIMIT, lane], actuators[i, HIGH] * Z[s.K_LIMIT, lane]


@lanes
def prepare_actuators(Z, M, width, actuators, first, last, step):
    """Compute the actuators' coefficients, which are constant during a flight."""
    for i in range(first, last):
        block = actuator_rows(i).block
        for lane in range(width):
            bandwidth = Z[s.K_BANDWIDTH, lane]
            damping = Z[s.K_DAMPING, lane]
            if i == ENGINE:
                bandwidth = Z[s.K_ENGINE_BANDWIDTH, lane]
                damping = Z[s.K_ENGINE_DAMPING, lane]
            bandwidth = actuators[i, BANDWIDTH] * bandwidth
            damping = actuators[i, DAMPING] * damping
            prepare_actuator(M, lane, block, bandwidth, damping, step)


@lanes
def prepare_actuator(Z, lane, block, bandwidth, damping, step):
    """Compute the coefficients of an actuator's step, and store them in its block of rows."""
    stiffness = bandwidth * bandwidth
    friction = 2.0 * damping * bandwidth
    Z[block + STIFFNESS, lane] = stiffness
    Z[block + FRICTION, lane] = friction
    e11, e12, e21, e22, i11, i12 = transition(stiffness, friction, step)
    Z[block + END, lane] = e11
    Z[block + END + 1, lane] = e12
    Z[block + END + 2, lane] = e21
    Z[block + END + 3, lane] = e22
    # The integrator's sum, step / 6 (start + 4 middle + end), must equal the integral.
    Z[block + MIDDLE, lane] = 0.25 * (6.0 / step * i11 - 1.0 - e11)
    Z[block + MIDDLE + 1, lane] = 0.25 * (6.0 / step * i12 - e12)
    e11, e12, e21, e22, _, _ = transition(stiffness, friction, step / SUBSTEPS)
    Z[block + SHORT, lane] = e11
    Z[block + SHORT + 1, lane] = e12
    Z[block + SHORT + 2, lane] = e21
    Z[block + SHORT + 3, lane] = e22
    growth = exp(bandwidth * step)
    Z[block + REACH, lane] = 0.5 * (growth + 1.0 / growth)
    Z[block + REACH + 1, lane] = 0.5 * bandwidth * (growth - 1.0 / growth)


@lanes
def run_actuator(Z, width, rows, low, high, rate_limit, step, recorded):
    """Compute an actuator's state after a step, and its position at the middle stages.

    The middle position is chosen so that the integrator's sum over the step equals the integral of
    the position. It agrees with the position half-way through the step to the integrator's order,
    also at limits. ``low``, ``high`` and ``rate_limit`` are [lane]. The command row of a recorded
    actuator contains its rate.
    """
    slow = 0
    block = rows.block
    for lane in range(width):
        position = Z[rows.position, lane]
        rate = Z[rows.rate, lane]
        command = Z[rows.command, lane]
        error = position - command
        middle = command + (Z[block + MIDDLE, lane] * error + Z[block + MIDDLE + 1, lane] * rate)
        end = command + (Z[block + END, lane] * error + Z[block + END + 1, lane] * rate)
        end_rate = Z[block + END + 2, lane] * error + Z[block + END + 3, lane] * rate
        Z[rows.middle, lane] = position + 0.5 * step * command if recorded else middle
        Z[rows.end, lane] = position + step * command if recorded else end
        Z[rows.end_rate, lane] = 0.0 if recorded else end_rate
        reach = Z[block + REACH, lane] * abs(rate) + Z[block + REACH + 1, lane] * abs(error)
        span = step * reach
        inside = (
            reach < rate_limit[lane]
            and position - span > low[lane]
            and position + span < high[lane]
        )
        slow += 0 if inside else 1
    if slow == 0 or recorded:
        return
    short = step / SUBSTEPS
    for lane in range(width):
        start = Z[rows.position, lane]
        rate = Z[rows.rate, lane]
        command = Z[rows.command, lane]
        reach = Z[block + REACH, lane] * abs(rate) + Z[block + REACH + 1, lane] * abs(
            start - command
        )
        span = step * reach
        inside = reach < rate_limit[lane] and start - span > low[lane] and start + span < high[lane]
        response = Response(
            Z[block + STIFFNESS, lane],
            Z[block + FRICTION, lane],
            Z[block + SHORT, lane],
            Z[block + SHORT + 1, lane],
            Z[block + SHORT + 2, lane],
            Z[block + SHORT + 3, lane],
        )
        position = start
        total = 0.0
        for _ in range(SUBSTEPS):
            position, rate, integral = short_step(
                position, rate, command, response, short, low[lane], high[lane], rate_limit[lane]
            )
            total += integral
        middle = 0.25 * (6.0 / step * total - start - position)
        # A lane that reaches no limit keeps the exact step, so its result does not depend on other
        # lanes.
        Z[rows.middle, lane] = Z[rows.middle, lane] if inside else middle
        Z[rows.end, lane] = Z[rows.end, lane] if inside else position
        Z[rows.end_rate, lane] = Z[rows.end_rate, lane] if inside else rate


@lanes
def has_slack(actuators, i):
    """Return whether an actuator is of first order, or has a dead zone or backlash."""
    kind = actuators[i, KIND]
    return kind == FIRST_ORDER or actuators[i, DEAD_ZONE] > 0.0 or actuators[i, BACKLASH] > 0.0


@lanes
def find_slack(Z, width, actuators, i, zone, play):
    """Compute an actuator's dispersed dead zone, and half of its dispersed backlash [lane]."""
    # The row of the backlash follows the row of the dead zone.
    first = s.K_ENGINE_DEAD_ZONE if i == ENGINE else s.K_DEAD_ZONE
    for lane in range(width):
        zone[lane] = actuators[i, DEAD_ZONE] * Z[first, lane]
        play[lane] = 0.5 * actuators[i, BACKLASH] * Z[first + 1, lane]


@lanes
def command_ideal(Z, M, width, actuators, first, last):
    """Set ideal actuators to their limited commands at the start of a tick."""
    zone = Z[s.LIMITS + 3]
    play = Z[s.LIMITS + 4]
    for i in range(first, last):
        if actuators[i, KIND] != IDEAL:
            continue
        rows = actuator_rows(i)
        if has_slack(actuators, i):
            find_slack(Z, width, actuators, i, zone, play)
            for lane in range(width):
                low, high = limits_of(Z, lane, actuators, i)
                position = M[rows.position, lane]
                actuator = position + clamp(M[rows.ahead, lane], -play[lane], play[lane])
                command = clamp(M[rows.command, lane], low, high)
                actuator = command + clamp(actuator - command, -zone[lane], zone[lane])
                position = follow(position, actuator, play[lane])
                M[rows.position, lane] = position
                M[rows.middle, lane] = position
                M[rows.ahead, lane] = actuator - position
        else:
            for lane in range(width):
                low, high = limits_of(Z, lane, actuators, i)
                position = clamp(M[rows.command, lane], low, high)
                M[rows.position, lane] = position
                M[rows.middle, lane] = position


@lanes
def place_actuator(Z, lane, row, position):
    """Set the position of an actuator."""
    Z[X + row, lane] = position
    Z[XS + row, lane] = position


@routine
def run_slack_actuator(M, rows, bandwidth, low, high, rate_limit, zone, play, step):
    """Compute the step of an actuator that is first-order or has a dead zone or backlash.

    The results are stored in the same rows as by :func:`run_actuator`. ``bandwidth`` [lane] is the
    bandwidth of a first-order actuator, and 0 for second order.
    """
    short = step / SUBSTEPS
    block = rows.block
    for lane in range(low.size):
        surface = M[rows.position, lane]
        rate = M[rows.rate, lane]
        command = M[rows.command, lane]
        half = play[lane]
        start = M[rows.position, lane]
        position = surface + clamp(M[rows.ahead, lane], -half, half)
        response = Response(
            M[block + STIFFNESS, lane],
            M[block + FRICTION, lane],
            M[block + SHORT, lane],
            M[block + SHORT + 1, lane],
            M[block + SHORT + 2, lane],
            M[block + SHORT + 3, lane],
        )
        total = 0.0
        for _ in range(SUBSTEPS):
            before = position
            before_rate = rate
            ahead = position - surface
            position, rate, integral = slack_step(
                position,
                rate,
                command,
                response,
                bandwidth[lane],
                short,
                low[lane],
                high[lane],
                rate_limit[lane],
                zone[lane],
            )
            if half > 0.0:
                if bandwidth[lane] == 0.0:
                    turn = turning_point(before, before_rate, rate, short)
                    surface = follow(surface, turn, half)
                surface = follow(surface, position, half)
            else:
                surface = position
            total += integral - 0.5 * short * (ahead + position - surface)
        M[rows.middle, lane] = 0.25 * (6.0 / step * total - start - surface)
        M[rows.end, lane] = surface
        M[rows.end_rate, lane] = rate
        M[rows.ahead, lane] = position - surface


@lanes
def run_actuators(Z, M, width, actuators, first, last, step, recorded, active):
    """Compute the step of actuators ``first``..``last - 1``, after the step's first stage.

    Ideal actuators keep their positions. If ``active`` is None, no actuator has slack
    (:func:`has_slack`).
    """
    low = Z[s.LIMITS]
    high = Z[s.LIMITS + 1]
    rate_limit = Z[s.LIMITS + 2]
    for i in range(first, last):
        rows = actuator_rows(i)
        if actuators[i, KIND] == IDEAL and not recorded:
            for lane in range(width):
                M[rows.end, lane] = M[rows.position, lane]
                M[rows.end_rate, lane] = 0.0
            continue
        fastest = actuators[i, RATE_LIMIT]
        for lane in range(width):
            low[lane], high[lane] = limits_of(Z, lane, actuators, i)
        if i == ENGINE:
            for lane in range(width):
                rate_limit[lane] = fastest * Z[s.K_ENGINE_RATE, lane]
        else:
            for lane in range(width):
                rate_limit[lane] = fastest * Z[s.K_RATE, lane] * M[rows.slowed, lane]
        if active is not None and has_slack(actuators, i) and not recorded:
            zone = Z[s.LIMITS + 3]
            play = Z[s.LIMITS + 4]
            bandwidth = Z[s.LIMITS + 5]
            find_slack(Z, width, actuators, i, zone, play)
            factor = s.K_ENGINE_BANDWIDTH if i == ENGINE else s.K_BANDWIDTH
            lags = actuators[i, KIND] == FIRST_ORDER
            for lane in range(width):
                bandwidth[lane] = actuators[i, BANDWIDTH] * Z[factor, lane] if lags else 0.0
            run_slack_actuator(M, rows, bandwidth, low, high, rate_limit, zone, play, step)
        else:
            run_actuator(M, width, rows, low, high, rate_limit, step, recorded)


@lanes
def set_actuators(Z, width):
    """Set axes and engine to their state at the end of the step, for the last stage."""
    for i in range(s.AILERON, s.ETA_RATE + 1):
        for lane in range(width):
            Z[XS + i, lane] = Z[SUM + i, lane]
