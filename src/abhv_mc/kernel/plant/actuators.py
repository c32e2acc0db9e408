"""Surfaces and engine over an integrator step, in lanes.

They depend only on their commands, which are constant over a tick, so they are computed before the
equations of motion.
"""

from typing import NamedTuple

from abhv_mc.kernel.jit import lanes, scalar
from abhv_mc.kernel.numerics.angles import clamp
from abhv_mc.kernel.numerics.lane_math import exp
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.actuator_step import (
    END,
    FRICTION,
    MIDDLE,
    N_ACTUATOR_ROWS,
    REACH,
    SHORT,
    STIFFNESS,
    SUBSTEPS,
    Response,
    short_step,
    transition,
)
from abhv_mc.kernel.plant.state import SUM, XS, X, parameter_row

_K_ETA_LIMIT = parameter_row("engine.equivalence_ratio_limit")


@lanes
def pass_commands(Z, width):
    """Pass the commands of the law to the actuators."""
    for i in range(4):
        for lane in range(width):
            Z[s.ACTUATED + i, lane] = Z[s.CMD + i, lane]


@lanes
def prepare_actuators(Z, width, constants, step):
    """Prepare the coefficients of surfaces and engine, which are constant in a flight."""
    for lane in range(width):
        for engine in range(2):
            bandwidth = constants.surface_bandwidth * Z[s.K_BANDWIDTH, lane]
            damping = constants.surface_damping * Z[s.K_DAMPING, lane]
            if engine:
                bandwidth = constants.engine_bandwidth * Z[s.K_ENGINE_BANDWIDTH, lane]
                damping = constants.engine_damping * Z[s.K_ENGINE_DAMPING, lane]
            prepare_actuator(
                Z, lane, s.ACTUATORS + engine * N_ACTUATOR_ROWS, bandwidth, damping, step
            )


@lanes
def prepare_actuator(Z, lane, block, bandwidth, damping, step):
    """Compute the coefficients of an actuator's step, in its block of rows."""
    stiffness, friction = bandwidth * bandwidth, 2.0 * damping * bandwidth
    Z[block + STIFFNESS, lane], Z[block + FRICTION, lane] = stiffness, friction
    e11, e12, e21, e22, i11, i12 = transition(stiffness, friction, step)
    Z[block + END, lane], Z[block + END + 1, lane] = e11, e12
    Z[block + END + 2, lane], Z[block + END + 3, lane] = e21, e22
    # The integrator's sum, step / 6 (start + 4 middle + end), must equal the integral.
    Z[block + MIDDLE, lane] = 0.25 * (6.0 / step * i11 - 1.0 - e11)
    Z[block + MIDDLE + 1, lane] = 0.25 * (6.0 / step * i12 - e12)
    e11, e12, e21, e22, _, _ = transition(stiffness, friction, step / SUBSTEPS)
    Z[block + SHORT, lane], Z[block + SHORT + 1, lane] = e11, e12
    Z[block + SHORT + 2, lane], Z[block + SHORT + 3, lane] = e21, e22
    growth = exp(bandwidth * step)
    Z[block + REACH, lane] = 0.5 * (growth + 1.0 / growth)
    Z[block + REACH + 1, lane] = 0.5 * bandwidth * (growth - 1.0 / growth)


class Actuator(NamedTuple):
    """Rows of an actuator: position and rate before and after the step, command."""

    position: int
    rate: int
    middle: int
    end: int
    end_rate: int
    command: int
    block: int  # first row of prepare_actuator's coefficients


@scalar
def deflection_rows(i):
    """Return the rows of aileron, rudder or elevator."""
    position, rate = s.AILERON + i, s.AILERON_RATE + i
    return Actuator(
        X + position,
        X + rate,
        XS + position,
        SUM + position,
        SUM + rate,
        s.ACTUATED + i,
        s.ACTUATORS,
    )


@scalar
def engine_rows():
    """Return the rows of the engine."""
    block = s.ACTUATORS + N_ACTUATOR_ROWS
    return Actuator(
        X + s.ETA, X + s.ETA_RATE, XS + s.ETA, SUM + s.ETA, SUM + s.ETA_RATE, s.ACTUATED + 3, block
    )


@lanes
def run_actuator(Z, width, rows, low, high, rate_limit, step, recorded):
    """Compute an actuator's step: its end, and the position of the middle stages.

    The middle position makes the integrator's sum over the step the integral of the position: it equals
    the position half-way to the integrator's order, and is correct at limits, too. ``low``, ``high`` and
    ``rate_limit`` are [lane]. A recorded actuator has its rate in the command row.
    """
    slow, block = 0, rows.block
    for lane in range(width):
        position, rate, command = Z[rows.position, lane], Z[rows.rate, lane], Z[rows.command, lane]
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
        start, rate, command = Z[rows.position, lane], Z[rows.rate, lane], Z[rows.command, lane]
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
        position, total = start, 0.0
        for _ in range(SUBSTEPS):
            position, rate, integral = short_step(
                position, rate, command, response, short, low[lane], high[lane], rate_limit[lane]
            )
            total += integral
        middle = 0.25 * (6.0 / step * total - start - position)
        # A lane that meets no limit keeps the exact step, as it would without other lanes.
        Z[rows.middle, lane] = Z[rows.middle, lane] if inside else middle
        Z[rows.end, lane] = Z[rows.end, lane] if inside else position
        Z[rows.end_rate, lane] = Z[rows.end_rate, lane] if inside else rate


@lanes
def command_ideal(Z, width, constants):
    """Set deflections and throttle without dynamics to their limited commands."""
    if constants.ideal_surfaces > 0.0:
        for i in range(3):
            for lane in range(width):
                limit = constants.surface_limit * Z[s.K_LIMIT, lane]
                place_actuator(
                    Z, lane, s.AILERON + i, clamp(Z[s.ACTUATED + i, lane], -limit, limit)
                )
    if constants.ideal_engine > 0.0:
        for lane in range(width):
            highest = constants.equivalence_ratio_max * Z[_K_ETA_LIMIT, lane]
            eta = clamp(Z[s.ACTUATED + 3, lane], constants.equivalence_ratio_min, highest)
            place_actuator(Z, lane, s.ETA, eta)


@lanes
def place_actuator(Z, lane, row, position):
    """Set the position of an actuator."""
    Z[X + row, lane] = position
    Z[XS + row, lane] = position


@lanes
def rest_actuator(Z, width, position_row, rate_row):
    """Keep the position of an actuator through a step."""
    for lane in range(width):
        Z[SUM + position_row, lane] = Z[X + position_row, lane]
        Z[SUM + rate_row, lane] = 0.0


@lanes
def run_actuators(Z, width, constants, step, recorded):
    """Compute surfaces and engine through a step, after its first stage."""
    low, high, rate_limit = Z[s.LIMITS], Z[s.LIMITS + 1], Z[s.LIMITS + 2]
    for lane in range(width):
        limit = constants.surface_limit * Z[s.K_LIMIT, lane]
        low[lane], high[lane] = -limit, limit
    for i in range(3):
        if constants.ideal_surfaces > 0.0 and not recorded:
            rest_actuator(Z, width, s.AILERON + i, s.AILERON_RATE + i)
            continue
        for lane in range(width):
            rate_limit[lane] = (
                constants.surface_rate_limit * Z[s.K_RATE, lane] * Z[s.RATE_FACTOR + i, lane]
            )
        run_actuator(Z, width, deflection_rows(i), low, high, rate_limit, step, recorded)
    if constants.ideal_engine > 0.0 and not recorded:
        rest_actuator(Z, width, s.ETA, s.ETA_RATE)
        return
    for lane in range(width):
        low[lane] = constants.equivalence_ratio_min
        high[lane] = constants.equivalence_ratio_max * Z[_K_ETA_LIMIT, lane]
        rate_limit[lane] = constants.engine_rate_limit * Z[s.K_ENGINE_RATE, lane]
    run_actuator(Z, width, engine_rows(), low, high, rate_limit, step, recorded)


@lanes
def set_actuators(Z, width):
    """Set surfaces and engine to the end of the step, for its last stage."""
    for i in range(s.AILERON, s.ETA_RATE + 1):
        for lane in range(width):
            Z[XS + i, lane] = Z[SUM + i, lane]
