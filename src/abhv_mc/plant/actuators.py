"""Surfaces and engine: second order towards a held command (Zhu & Shen 2014, eq. (4)), with rate limits and stops.

They depend on their commands alone, which are held over a tick, so they run ahead of the equations of motion: a step
between the limits is exact; one that may meet a limit goes in short steps that follow it. A limit met in the middle of
a long step would cost the integrator its order.
"""

from abhv_mc.jit import lanes, scalar
from abhv_mc.numerics.angles import clamp
from abhv_mc.numerics.lane_math import exp
from abhv_mc.plant import state as s
from abhv_mc.plant.state import SUM, XS, X, parameter_row

SUBSTEPS = 16  # short steps of an integrator step
_TERMS = 40  # of the matrix exponential's series

_K_BANDWIDTH = parameter_row("actuator.bandwidth")
_K_DAMPING = parameter_row("actuator.damping")
_K_LIMIT = parameter_row("actuator.deflection_limit")
_K_RATE = parameter_row("actuator.rate_limit")
_K_ENGINE_BANDWIDTH = parameter_row("engine.bandwidth")
_K_ENGINE_DAMPING = parameter_row("engine.damping")
_K_ENGINE_RATE = parameter_row("engine.rate_limit")
_K_ETA_LIMIT = parameter_row("engine.equivalence_ratio_limit")

# Rows of an actuator's own block.
_STIFFNESS, _FRICTION = range(2)  # wn^2, 2 zeta wn
_END = 2  # position error and rate at the end of a step: [e, r] times four numbers by rows
_MIDDLE = 6  # what the stages between feel: two numbers
_SHORT = 8  # as _END, of a short step
_REACH = 12  # no rate in a step is above these times |rate| and |error|
_BLOCK = 14


@scalar
def transition(stiffness, friction, step):
    """exp(A step), A = [[0, 1], [-stiffness, -friction]], by rows, and the first row of its integral over the step."""
    e11, e12, e21, e22 = 1.0, 0.0, 0.0, 1.0
    i11, i12 = 1.0, 0.0
    for k in range(_TERMS, 0, -1):  # Horner: I + A step / k (I + ...); the integral has k + 1
        x, y = step / k, step / (k + 1)
        i11, i12 = 1.0 - y * stiffness * i12, y * (i11 - friction * i12)
        e11, e12, e21, e22 = (
            1.0 + x * e21,
            x * e22,
            -x * (stiffness * e11 + friction * e21),
            1.0 - x * (stiffness * e12 + friction * e22),
        )
    return e11, e12, e21, e22, step * i11, step * i12


@lanes
def prepare_actuators(Z, width, constants, step):
    """The blocks of the surfaces and of the engine; bandwidth and damping stay over a flight."""
    for lane in range(width):
        for engine in range(2):
            block = s.ACTUATORS + engine * _BLOCK
            bandwidth = constants.surface_bandwidth * Z[_K_BANDWIDTH, lane]
            damping = constants.surface_damping * Z[_K_DAMPING, lane]
            if engine:
                bandwidth = constants.engine_bandwidth * Z[_K_ENGINE_BANDWIDTH, lane]
                damping = constants.engine_damping * Z[_K_ENGINE_DAMPING, lane]
            stiffness, friction = bandwidth * bandwidth, 2.0 * damping * bandwidth
            Z[block + _STIFFNESS, lane], Z[block + _FRICTION, lane] = stiffness, friction
            e11, e12, e21, e22, i11, i12 = transition(stiffness, friction, step)
            Z[block + _END, lane], Z[block + _END + 1, lane] = e11, e12
            Z[block + _END + 2, lane], Z[block + _END + 3, lane] = e21, e22
            # The integrator's sum is step / 6 (start + 4 middle + end); it is to be the integral.
            Z[block + _MIDDLE, lane] = 0.25 * (6.0 / step * i11 - 1.0 - e11)
            Z[block + _MIDDLE + 1, lane] = 0.25 * (6.0 / step * i12 - e12)
            e11, e12, e21, e22, _, _ = transition(stiffness, friction, step / SUBSTEPS)
            Z[block + _SHORT, lane], Z[block + _SHORT + 1, lane] = e11, e12
            Z[block + _SHORT + 2, lane], Z[block + _SHORT + 3, lane] = e21, e22
            growth = exp(bandwidth * step)
            Z[block + _REACH, lane] = 0.5 * (growth + 1.0 / growth)
            Z[block + _REACH + 1, lane] = 0.5 * bandwidth * (growth - 1.0 / growth)


@scalar
def short_step(position, rate, command, stiffness, friction, e11, e12, e21, e22, step, low, high, rate_limit):
    """Position, rate and the integral of the position after a short step that may meet the limits."""
    error = position - command
    free = e21 * error + e22 * rate
    # A rate that leaves its limit within the step has gone on rising in ``free`` first: take that out.
    push = -(stiffness * error + friction * rate)
    outward = push if rate >= rate_limit else (-push if rate <= -rate_limit else 0.0)
    leaves = outward > 0.0 and abs(free) < rate_limit
    rise = 0.5 * outward * outward / (stiffness * rate_limit if leaves else 1.0)
    free -= (rise if rate > 0.0 else -rise) if leaves else 0.0
    end_rate = clamp(free, -rate_limit, rate_limit)
    met = free != end_rate
    # A rate that meets its limit goes there straight and stays.
    share = (end_rate - rate) / (free - rate if met else 1.0)
    moved = position + step * (end_rate - 0.5 * share * (end_rate - rate))
    moved = moved if met else command + (e11 * error + e12 * rate)
    # A surface goes straight into a stop, rests, and where the command is inside comes back for what is left.
    stop = clamp(moved, low, high)
    stopped = stop != moved
    path = stop - position
    share = path / (moved - position if stopped else 1.0)
    left = step * (1.0 - share)
    pull = stiffness * (command - stop)
    back = pull * left if (pull > 0.0) != (moved > stop) else 0.0
    smooth = 0.5 * step * (position + moved) + step * step / 12.0 * (rate - end_rate)
    return (
        stop + 0.5 * left * back if stopped else moved,
        back if stopped else end_rate,
        step * (stop - 0.5 * share * path) if stopped else smooth,
    )


@lanes
def run_actuator(Z, width, position_row, rate_row, command_row, block, low, high, rate_limit, step, recorded):
    """One actuator from ``X`` through a step: its end into ``SUM``, what the stages between feel into ``XS``.

    That is not the position half way but the one with which the integrator's sum over the step is the integral of the
    position: the same to the integrator's order, and right where a limit bends the way. low, high, rate_limit: [lane].
    A recorded actuator has its rate in the command row.
    """
    slow = 0
    for lane in range(width):
        position, rate, command = Z[X + position_row, lane], Z[X + rate_row, lane], Z[command_row, lane]
        error = position - command
        middle = command + (Z[block + _MIDDLE, lane] * error + Z[block + _MIDDLE + 1, lane] * rate)
        end = command + (Z[block + _END, lane] * error + Z[block + _END + 1, lane] * rate)
        end_rate = Z[block + _END + 2, lane] * error + Z[block + _END + 3, lane] * rate
        Z[XS + position_row, lane] = position + 0.5 * step * command if recorded else middle
        Z[SUM + position_row, lane] = position + step * command if recorded else end
        Z[SUM + rate_row, lane] = 0.0 if recorded else end_rate
        reach = Z[block + _REACH, lane] * abs(rate) + Z[block + _REACH + 1, lane] * abs(error)
        span = step * reach
        inside = reach < rate_limit[lane] and position - span > low[lane] and position + span < high[lane]
        slow += 0 if inside else 1
    if slow == 0 or recorded:
        return
    short = step / SUBSTEPS
    for lane in range(width):
        start, rate, command = Z[X + position_row, lane], Z[X + rate_row, lane], Z[command_row, lane]
        reach = Z[block + _REACH, lane] * abs(rate) + Z[block + _REACH + 1, lane] * abs(start - command)
        span = step * reach
        inside = reach < rate_limit[lane] and start - span > low[lane] and start + span < high[lane]
        stiffness, friction = Z[block + _STIFFNESS, lane], Z[block + _FRICTION, lane]
        e11, e12 = Z[block + _SHORT, lane], Z[block + _SHORT + 1, lane]
        e21, e22 = Z[block + _SHORT + 2, lane], Z[block + _SHORT + 3, lane]
        position, total = start, 0.0
        for _ in range(SUBSTEPS):
            position, rate, integral = short_step(
                position,
                rate,
                command,
                stiffness,
                friction,
                e11,
                e12,
                e21,
                e22,
                short,
                low[lane],
                high[lane],
                rate_limit[lane],
            )
            total += integral
        middle = 0.25 * (6.0 / step * total - start - position)
        # A lane that meets no limit keeps what it would have alone.
        Z[XS + position_row, lane] = Z[XS + position_row, lane] if inside else middle
        Z[SUM + position_row, lane] = Z[SUM + position_row, lane] if inside else position
        Z[SUM + rate_row, lane] = Z[SUM + rate_row, lane] if inside else rate


@lanes
def run_actuators(Z, width, constants, step, recorded):
    """Surfaces and engine through a step, after its first stage."""
    low, high, rate_limit = Z[s.LIMITS], Z[s.LIMITS + 1], Z[s.LIMITS + 2]
    for lane in range(width):
        limit = constants.surface_limit * Z[_K_LIMIT, lane]
        low[lane], high[lane] = -limit, limit
        rate_limit[lane] = constants.surface_rate_limit * Z[_K_RATE, lane]
    for i in range(3):
        run_actuator(
            Z, width, s.AILERON + i, s.AILERON_RATE + i, s.CMD + i, s.ACTUATORS, low, high, rate_limit, step, recorded
        )
    for lane in range(width):
        low[lane] = constants.equivalence_ratio_min
        high[lane] = constants.equivalence_ratio_max * Z[_K_ETA_LIMIT, lane]
        rate_limit[lane] = constants.engine_rate_limit * Z[_K_ENGINE_RATE, lane]
    run_actuator(Z, width, s.ETA, s.ETA_RATE, s.CMD_ETA, s.ACTUATORS + _BLOCK, low, high, rate_limit, step, recorded)


@lanes
def set_actuators(Z, width):
    """Surfaces and engine at the end of the step, for its last stage."""
    for i in range(s.AILERON, s.ETA_RATE + 1):
        for lane in range(width):
            Z[XS + i, lane] = Z[SUM + i, lane]
