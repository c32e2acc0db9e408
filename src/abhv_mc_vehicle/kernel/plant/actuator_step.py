"""Step of a second-order actuator (Zhu & Shen 2014, eq. (4)) with rate limit and stops.

The command is constant over the step. Within the limits the step is exact. A step that may reach a
limit is split into short steps, because a limit reached within a long step would reduce the
integrator's order. First-order actuators, and actuators with a dead zone or backlash, always use
short steps.
"""

from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, exp

# Columns of ``Vehicle.actuators``, the list of actuators, in SI units and radians. For first-order
# actuators the damping ratio is 0.5, and 2 damping / bandwidth is the time constant. The dead zone
# is the largest error between command and position that moves nothing. The backlash is the total
# free play between the actuator and its surface.
COLUMNS = (
    *("low", "high", "rate_limit", "bandwidth", "damping", "kind"),
    *("dead_zone", "backlash"),
)
LOW, HIGH, RATE_LIMIT, BANDWIDTH, DAMPING, KIND, DEAD_ZONE, BACKLASH = range(len(COLUMNS))
SLACK = COLUMNS[DEAD_ZONE:]  # nonlinearities other than limits
KINDS = ("second_order", "first_order", "ideal")
SECOND_ORDER, FIRST_ORDER, IDEAL = range(len(KINDS))
# number of axes, whose actuators come first; index of the engine's actuator; index of the first
# effector's actuator
AXES = 3
ENGINE = 3
FIRST_EFFECTOR = 4

SUBSTEPS = 16  # number of short steps per integrator step
_TERMS = 40  # number of terms in the series of the matrix exponential

# rows of an actuator's block in the lane memory
STIFFNESS, FRICTION = range(2)  # wn^2 and 2 zeta wn
END = 2  # position error and rate after a step: four coefficients of [error, rate], row by row
MIDDLE = 6  # position at the middle stages: two coefficients
SHORT = 8  # four coefficients like those of END, for a short step
REACH = 12  # coefficients of |rate| and |error| that bound the rate in a step
N_ACTUATOR_ROWS = 14


class Response(NamedTuple):
    """Coefficients of an actuator's equation, and its transition matrix over a short step."""

    stiffness: float  # stiffness, 1/s2
    friction: float  # friction, 1/s
    e11: float
    e12: float
    e21: float
    e22: float


@scalar
def transition(stiffness, friction, step):
    """Return exp(A step) of A = [[0, 1], [-stiffness, -friction]], and row 1 of its integral.

    Matrices are given by rows; the integral is taken over the step.
    """
    e11 = 1.0
    e12 = 0.0
    e21 = 0.0
    e22 = 1.0
    i11 = 1.0
    i12 = 0.0
    # Both series are evaluated by Horner's scheme, I + A step / k (I + ...); the series of the
    # integral has k + 1 instead of k.
    for k in range(_TERMS, 0, -1):
        x = step / k
        y = step / (k + 1)
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
    """Return position, rate and position integral after a step that may reach limits."""
    stiffness, friction, e11, e12, e21, e22 = response
    error = position - command
    free = e21 * error + e22 * rate
    # A rate at its limit that decreases only later in the step would first exceed the limit in
    # ``free``; this excess is subtracted.
    push = -(stiffness * error + friction * rate)
    outward = push if rate >= rate_limit else (-push if rate <= -rate_limit else 0.0)
    leaves = outward > 0.0 and abs(free) < rate_limit
    rise = 0.5 * outward * outward / (stiffness * rate_limit if leaves else 1.0)
    free -= (rise if rate > 0.0 else -rise) if leaves else 0.0
    end_rate = clamp(free, -rate_limit, rate_limit)
    meets_limit = free != end_rate
    # The rate changes linearly until it reaches its limit and is constant afterwards.
    share = (end_rate - rate) / (free - rate if meets_limit else 1.0)
    end_position = position + step * (end_rate - 0.5 * share * (end_rate - rate))
    end_position = end_position if meets_limit else command + (e11 * error + e12 * rate)
    # A surface moves linearly to a stop, rests there, and returns if its command is within range.
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


@scalar
def lag_step(position, command, bandwidth, step, low, high, rate_limit):
    """Return position, rate and position integral after a first-order actuator's step.

    The actuator first moves at its rate limit, then approaches the command exponentially.
    """
    error = abs(position - command)
    side = 1.0 if position > command else -1.0
    limited = clamp(error / rate_limit - 1.0 / bandwidth, 0.0, step) if error > 0.0 else 0.0
    near = error - rate_limit * limited if limited > 0.0 else error
    left = near * exp(bandwidth * (limited - step))
    end = command + side * left
    integral = command * step + side * (0.5 * limited * (error + near) + (near - left) / bandwidth)
    stop = clamp(end, low, high)
    end_rate = -side * min(bandwidth * left, rate_limit)
    if stop != end:
        end_rate = 0.0
        integral = 0.5 * step * (position + stop)
    return stop, end_rate, integral


@scalar
def mean_within(a, b, zone):
    """Return the mean of x clamped to +-zone, for x from ``a`` to ``b``."""
    at_a = clamp(a, -zone, zone)
    at_b = clamp(b, -zone, zone)
    span = b - a
    short = abs(span) < 1e-9
    integral = at_b * (b - 0.5 * at_b) - at_a * (a - 0.5 * at_a)
    return 0.5 * (at_a + at_b) if short else integral / (1.0 if short else span)


@scalar
def slack_step(position, rate, command, response, bandwidth, step, low, high, rate_limit, zone):
    """Return position, rate and position integral after a step with a dead zone.

    Only the error beyond the dead zone acts: the effective command is the point of the zone about
    the command that is closest to the position. ``bandwidth`` is that of a first-order actuator, 0
    for second order.
    """
    error = position - command
    if bandwidth > 0.0:
        aim = command + clamp(error, -zone, zone)
        return lag_step(position, aim, bandwidth, step, low, high, rate_limit)
    aim = command + clamp(error, -zone, zone)
    guess, _, _ = short_step(position, rate, aim, response, step, low, high, rate_limit)
    aim = command + mean_within(error, guess - command, zone)
    return short_step(position, rate, aim, response, step, low, high, rate_limit)


@scalar
def turning_point(position, rate, end_rate, step):
    """Return the position at which the rate changes its sign within a step.

    If the rate keeps its sign, return the position at the start of the step.
    """
    turns = (rate > 0.0) != (end_rate > 0.0)
    time = step * rate / (rate - end_rate if turns and rate != end_rate else 1.0)
    return position + (0.5 * rate * time if turns else 0.0)


@scalar
def follow(surface, actuator, play):
    """Return the position of a surface moved by an actuator with a backlash of 2 ``play``."""
    return clamp(surface, actuator - play, actuator + play)
