"""Step of a second-order actuator (Zhu & Shen 2014, eq. (4)) with rate limit and stops.

The command is constant over the step. Within the limits the step is exact. A step that may meet a limit
is split into short steps, as a limit met within a long step would reduce the integrator's order.
"""

from typing import NamedTuple

from abhv_mc.kernel.jit import scalar
from abhv_mc.kernel.numerics.angles import clamp

SUBSTEPS = 16  # short steps of an integrator step
_TERMS = 40  # of the matrix exponential's series

# Rows of an actuator's block in the lane memory.
STIFFNESS, FRICTION = range(2)  # wn^2, 2 zeta wn
END = 2  # position error and rate at the end of a step: [e, r] times four numbers by rows
MIDDLE = 6  # position of the middle stages: two numbers
SHORT = 8  # as END, for a short step
REACH = 12  # bound of the rate in a step: these two numbers times |rate| and |error|
N_ACTUATOR_ROWS = 14


class Response(NamedTuple):
    """Coefficients of an actuator's equation and its transition over a short step, by rows."""

    stiffness: float  # 1/s2
    friction: float  # 1/s
    e11: float
    e12: float
    e21: float
    e22: float


@scalar
def transition(stiffness, friction, step):
    """Return exp(A step), A = [[0, 1], [-stiffness, -friction]], and its integral's row 1.

    Matrices are given by rows; the integral is over the step.
    """
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


@scalar
def short_step(position, rate, command, response, step, low, high, rate_limit):
    """Return position, rate and the position's integral after a step that may meet limits."""
    stiffness, friction, e11, e12, e21, e22 = response
    error = position - command
    free = e21 * error + e22 * rate
    # ``free`` lets a rate at its limit rise further before it falls; this rise is removed.
    push = -(stiffness * error + friction * rate)
    outward = push if rate >= rate_limit else (-push if rate <= -rate_limit else 0.0)
    leaves = outward > 0.0 and abs(free) < rate_limit
    rise = 0.5 * outward * outward / (stiffness * rate_limit if leaves else 1.0)
    free -= (rise if rate > 0.0 else -rise) if leaves else 0.0
    end_rate = clamp(free, -rate_limit, rate_limit)
    meets_limit = free != end_rate
    # A rate that meets its limit changes linearly before and is constant afterwards.
    share = (end_rate - rate) / (free - rate if meets_limit else 1.0)
    end_position = position + step * (end_rate - 0.5 * share * (end_rate - rate))
    end_position = end_position if meets_limit else command + (e11 * error + e12 * rate)
    # A surface moves linearly to a stop, rests there, and returns in the time left if its command is inside.
    stop = clamp(end_position, low, high)
    stopped = stop != end_position
    path = stop - position
    share = path / (end_position - position if stopped else 1.0)
    time_left = step * (1.0 - share)
    pull = stiffness * (command - stop)
    return_rate = pull * time_left if (pull > 0.0) != (end_position > stop) else 0.0
    smooth = 0.5 * step * (position + end_position) + step * step / 12.0 * (rate - end_rate)
    return (
        stop + 0.5 * time_left * return_rate if stopped else end_position,
        return_rate if stopped else end_rate,
        step * (stop - 0.5 * share * path) if stopped else smooth,
    )
