"""Failures of surfaces, engine and sensors at a control tick, from flight parameters.

If all failure times are infinite, all factors are 1 and all added values are 0, so the results of
the flight are unchanged bit for bit. A failure acts from the first control tick at or after its
time.
"""

from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, exp
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import (
    BANDWIDTH,
    DAMPING,
    ENGINE,
    IDEAL,
    KIND,
    RATE_LIMIT,
)
from abhv_mc_vehicle.kernel.plant.actuators import COMMAND, MOVES, N_EFFECTOR_ROWS, POSITION, SLOWED
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane
from abhv_mc_vehicle.kernel.plant.effectors import command_effectors
from abhv_mc_vehicle.kernel.plant.state import XS, X, parameter_row, parameter_rows
from abhv_mc_vehicle.kernel.plant.vehicle import (
    AXES,
    EFFECTORS,
    ENGINES,
    FAILURE_TIMES,
    MAX_ACTUATORS,
    NEVER,
)

N_AXES = len(AXES)
N_EFFECTORS = len(EFFECTORS)
N_ENGINES = len(ENGINES)
_N_FIRST = 4  # number of effectors whose failures are in the first block of parameters
_SAME_TIME = 1e-9  # tolerance when the time of a tick is compared with a failure time, s

_TIMES = parameter_row(FAILURE_TIMES[0])  # three failure times per surface: stuck, loss, slow
_EFFECTOR_TIMES = parameter_row(f"failure.{EFFECTORS[0]}.stuck_time")
_ENGINE_TIME = parameter_row("failure.engine.time")
_SENSOR_TIMES = parameter_row("failure.sensor.altitude.time")
_MODES = parameter_row(
    "failure.aileron.stuck_at"
)  # three values per surface: stuck_at, effectiveness, rate_limit
_EFFECTOR_MODES = parameter_row(f"failure.{EFFECTORS[0]}.stuck_at")
_MORE_TIMES = parameter_row(f"failure.{EFFECTORS[_N_FIRST]}.stuck_time")
_MORE_MODES = parameter_row(f"failure.{EFFECTORS[_N_FIRST]}.stuck_at")
_ENGINE_TIMES, _ENGINE_DURATION, _ENGINE_FACTOR = (
    parameter_row(f"failure.{ENGINES[0]}.{name}") for name in ("time", "duration", "thrust")
)
_DURATION, _THRUST, _DRAG, _PITCH = parameter_rows("failure.engine.duration", 4)
_BIAS = parameter_row("failure.sensor.altitude.bias")
_EFFECTIVENESS = parameter_row("control.aileron_effectiveness")
_EFFECTOR_EFFECTIVENESS = parameter_row(f"control.{EFFECTORS[0]}_effectiveness")


class Failures(NamedTuple):
    """Failures that occur in any lane; other failures are not computed."""

    surfaces: bool
    effectors: bool
    engine: bool
    engines: bool  # whether individual engines can fail
    sensors: bool


@lanes
def possible_failures(Z, width, constants):
    """Determine the possible failures from flight parameters and the vehicle's inlet."""
    return Failures(
        constants.driven == 0.0 and any_lane(Z, width, _TIMES, 3 * N_AXES, NEVER),
        any_lane(Z, width, _EFFECTOR_TIMES, 3 * _N_FIRST, NEVER)
        or any_lane(Z, width, _MORE_TIMES, 3 * (N_EFFECTORS - _N_FIRST), NEVER)
        or any_lane(Z, width, _EFFECTOR_EFFECTIVENESS, N_EFFECTORS, 1.0),
        any_lane(Z, width, _ENGINE_TIME, 1, NEVER) or constants.inlet.unstarts > 0.0,
        any_lane(Z, width, _ENGINE_TIMES, N_ENGINES, NEVER),
        any_lane(Z, width, _SENSOR_TIMES, s.N_MEASURED, NEVER),
    )


@lanes
def start_failures(Z, width):
    """Initialize all lanes without failures, after their parameters have been set."""
    for lane in range(width):
        for i in range(N_AXES):
            Z[s.RATE_FACTOR + i, lane] = 1.0
            Z[s.EFFECT + i, lane] = Z[_EFFECTIVENESS + i, lane]
            Z[s.STUCK_SURFACE + i, lane] = NEVER
        for i in range(MAX_ACTUATORS):
            Z[s.EFFECTOR_GAIN + i, lane] = (
                Z[_EFFECTOR_EFFECTIVENESS + i, lane] if i < N_EFFECTORS else 1.0
            )
            Z[s.STUCK_EFFECTOR + i, lane] = NEVER
            Z[s.SLOW_EFFECTOR + i, lane] = NEVER
        Z[s.ENGINE_THRUST, lane] = 1.0
        for i in range(N_ENGINES + 1):
            Z[s.ENGINE_WHOLE + i, lane] = 1.0
        Z[s.FAILED_TIME, lane] = -NEVER


@lanes
def fail_sensors(Z, width, time):
    """Freeze the measurements of failed sensors, or add a bias if a bias is specified."""
    for i in range(s.N_MEASURED):
        for lane in range(width):
            failed = time >= Z[_SENSOR_TIMES + i, lane] - _SAME_TIME
            measured = Z[s.MEASURED + i, lane]
            bias = Z[_BIAS + i, lane]
            frozen = Z[s.FROZEN + i, lane] if failed and time > 0.0 else measured
            Z[s.FROZEN + i, lane] = frozen
            Z[s.MEASURED + i, lane] = (
                (measured + bias if bias != 0.0 else frozen) if failed else measured
            )


@lanes
def fail_plant(Z, A, width, failures, vehicle, time, tick):
    """Compute the actuators' commands and the failures' factors at ``time`` (s).

    ``tick`` is the control period. Call this function after the commands of the control law have
    been copied to the actuators.
    """
    if failures.surfaces:
        fail_surfaces(Z, width, vehicle.actuators, time)
    command_effectors(Z, A, width, vehicle)
    if failures.effectors:
        fail_effectors(Z, A, width, vehicle, time, tick)
    if failures.engine:
        fail_engine(Z, width, vehicle, time, tick)
    if failures.engines:
        fail_engines(Z, width, vehicle, failures.engine, time, tick)


@lanes
def hold_stuck(Z, lane, row, target, position, stuck):
    """Return a stuck surface's deflection: ``target``, or the ``position`` where it stuck.

    The deflection is stored in ``row``.
    """
    deflection = Z[row, lane]
    deflection = (position if deflection == NEVER else deflection) if target == NEVER else target
    Z[row, lane] = deflection if stuck else NEVER
    return deflection


@lanes
def fail_surfaces(Z, width, actuators, time):
    """Apply failures to aileron, rudder and elevator.

    A surface that sticks at its current position stops immediately. If the failure specifies a
    deflection, the actuator first drives the surface there.
    """
    for i in range(N_AXES):
        for lane in range(width):
            stuck, lost, slow = has_failed(Z, lane, _TIMES + 3 * i, time)
            factor = Z[_MODES + 3 * i + 2, lane] if slow else 1.0
            Z[s.EFFECT + i, lane] = Z[_EFFECTIVENESS + i, lane] * (
                Z[_MODES + 3 * i + 1, lane] if lost else 1.0
            )
            Z[s.RATE_FACTOR + i, lane] = factor
            fastest = actuators[i, RATE_LIMIT] * Z[s.K_RATE, lane] * factor
            rate = Z[X + s.AILERON_RATE + i, lane]
            rate = clamp(rate, -fastest, fastest) if slow else rate
            target = Z[_MODES + 3 * i, lane]
            deflection = hold_stuck(
                Z, lane, s.STUCK_SURFACE + i, target, Z[X + s.AILERON + i, lane], stuck
            )
            Z[s.ACTUATED + i, lane] = deflection if stuck else Z[s.ACTUATED + i, lane]
            Z[X + s.AILERON_RATE + i, lane] = 0.0 if stuck and target == NEVER else rate
            Z[XS + s.AILERON_RATE + i, lane] = Z[X + s.AILERON_RATE + i, lane]


@lanes
def fail_driven_effector(Z, A, width, e, time):
    """Apply failures to an effector with an actuator, like :func:`fail_surfaces`."""
    first = e * N_EFFECTOR_ROWS
    times, modes = failure_rows(e)
    for lane in range(width):
        stuck, lost, slow = has_failed(Z, lane, times, time)
        deflection = hold_stuck(
            Z, lane, s.STUCK_EFFECTOR + e, Z[modes, lane], A[first + POSITION, lane], stuck
        )
        A[first + COMMAND, lane] = deflection if stuck else A[first + COMMAND, lane]
        A[first + MOVES, lane] = (
            0.0 if stuck and Z[modes, lane] == NEVER else A[first + MOVES, lane]
        )
        A[first + SLOWED, lane] *= Z[modes + 2, lane] if slow else 1.0
        Z[s.EFFECTOR_GAIN + e, lane] = Z[_EFFECTOR_EFFECTIVENESS + e, lane] * (
            Z[modes + 1, lane] if lost else 1.0
        )
        Z[s.EFFECTOR_OFFSET + e, lane] = 0.0


@lanes
def failure_rows(e):
    """Return the first rows of an effector's three failure times and three values."""
    if e < _N_FIRST:
        return _EFFECTOR_TIMES + 3 * e, _EFFECTOR_MODES + 3 * e
    return _MORE_TIMES + 3 * (e - _N_FIRST), _MORE_MODES + 3 * (e - _N_FIRST)


@lanes
def has_failed(Z, lane, times, time):
    """Return three flags: whether a surface is stuck, has lost effectiveness, or is slow."""
    return (
        time >= Z[times, lane] - _SAME_TIME,
        time >= Z[times + 1, lane] - _SAME_TIME,
        time >= Z[times + 2, lane] - _SAME_TIME,
    )


@lanes
def fail_effectors(Z, A, width, vehicle, time, tick):
    """Apply failures to the effectors, which are mixed from the three axis deflections.

    A slow effector follows its mix at a reduced rate limit, and is constant over the tick.
    """
    constants = vehicle.constants
    mix = vehicle.effector_mix
    fastest = vehicle.actuators[0, RATE_LIMIT]
    for e in range(mix.shape[0]):
        if constants.driven > 0.0:
            fail_driven_effector(Z, A, width, e, time)
            continue
        times, modes = failure_rows(e)
        reach = abs(mix[e, 0]) + abs(mix[e, 1]) + abs(mix[e, 2])
        for lane in range(width):
            mixed = 0.0
            for i in range(N_AXES):
                mixed += mix[e, i] * (Z[s.EFFECT + i, lane] * Z[X + s.AILERON + i, lane])
            stuck, lost, slow = has_failed(Z, lane, times, time)
            factor = Z[modes + 2, lane]
            farthest = fastest * Z[s.K_RATE, lane] * factor * reach * tick
            last = Z[s.SLOW_EFFECTOR + e, lane]
            limited = mixed if last == NEVER else clamp(mixed, last - farthest, last + farthest)
            Z[s.SLOW_EFFECTOR + e, lane] = limited if slow else NEVER
            gain = Z[_EFFECTOR_EFFECTIVENESS + e, lane] * (Z[modes + 1, lane] if lost else 1.0)
            deflection = gain * (limited if slow else mixed)
            stuck_deflection = hold_stuck(
                Z, lane, s.STUCK_EFFECTOR + e, Z[modes, lane], deflection, stuck
            )
            Z[s.EFFECTOR_GAIN + e, lane] = 0.0 if stuck or slow else gain
            Z[s.EFFECTOR_OFFSET + e, lane] = (
                stuck_deflection if stuck else (gain * limited if slow else 0.0)
            )


@lanes
def settle(value, target, lag, tick):
    """Return a first-order response to ``target`` after a tick, and its mean over the tick."""
    decay = exp(-tick / lag) if lag > 0.0 else 0.0
    return target + decay * (value - target), target + (1.0 - decay) * (lag / tick) * (
        value - target
    )


@lanes
def engine_lag(Z, lane, actuators):
    """Return the time constant of the engine's response, s."""
    damping = actuators[ENGINE, DAMPING] * Z[s.K_ENGINE_DAMPING, lane]
    return 2.0 * damping / (actuators[ENGINE, BANDWIDTH] * Z[s.K_ENGINE_BANDWIDTH, lane])


@lanes
def fails_now(Z, lane, time, begin, duration):
    """Return whether ``time`` is within a failure with the given start and duration."""
    since = time - Z[begin, lane]
    return since >= -_SAME_TIME and since < Z[duration, lane] - _SAME_TIME


@lanes
def fail_engine(Z, width, vehicle, time, tick):
    """Compute thrust, drag and pitching moment after an engine failure or inlet unstart.

    The thrust decays with the lag of the engine. After the failure and a relight delay, it recovers
    with the relight time constant.
    """
    constants = vehicle.constants
    inlet = vehicle.constants.inlet
    ideal = vehicle.actuators[ENGINE, KIND] == IDEAL
    for lane in range(width):
        lag = engine_lag(Z, lane, vehicle.actuators)
        unstarted = Z[s.UNSTARTED, lane] > 0.0
        failed = fails_now(Z, lane, time, _ENGINE_TIME, _DURATION) or unstarted
        last = time if failed else Z[s.FAILED_TIME, lane]
        is_off = time - last < constants.relight_delay - _SAME_TIME
        before = Z[s.ENGINE_WHOLE, lane]
        aim = Z[_THRUST, lane] if failed or is_off else 1.0
        slow = (
            constants.relight_time_constant
            if aim > before and constants.relight_time_constant > 0.0
            else lag
        )
        is_immediate = ideal and slow == lag
        Z[s.ENGINE_WHOLE, lane], Z[s.ENGINE_THRUST, lane] = settle(
            before, aim, 0.0 if is_immediate else slow, tick
        )
        Z[s.FAILED_TIME, lane] = last
        Z[s.ENGINE_DRAG, lane] = (Z[_DRAG, lane] if failed else 0.0) + (
            inlet.drag_increment if unstarted else 0.0
        )
        pitch = inlet.pitching_moment_increment if unstarted else 0.0
        Z[s.ENGINE_PITCH, lane] = (Z[_PITCH, lane] if failed else 0.0) + pitch
        Z[s.ENGINE_FAILED, lane] = 1.0 if failed else 0.0


@lanes
def fail_engines(Z, width, vehicle, engine_fails, time, tick):
    """Apply failures of individual engines, whose reduced thrust shifts the thrust line.

    Each engine's thrust decays and recovers with the lag of the engine. ``engine_fails`` is true if
    :func:`fail_engine` has been called.
    """
    ideal = vehicle.actuators[ENGINE, KIND] == IDEAL
    for lane in range(width):
        lag = 0.0 if ideal else engine_lag(Z, lane, vehicle.actuators)
        remaining = 1.0
        x = 0.0
        y = 0.0
        z = 0.0
        any_failed = False
        for i in range(vehicle.engines.shape[0]):
            failed = fails_now(Z, lane, time, _ENGINE_TIMES + i, _ENGINE_DURATION + i)
            aim = Z[_ENGINE_FACTOR + i, lane] if failed else 1.0
            Z[s.ENGINE_RUNS + i, lane], mean = settle(Z[s.ENGINE_RUNS + i, lane], aim, lag, tick)
            lost = vehicle.engines[i, 0] * (mean - 1.0)
            remaining += lost
            x += lost * vehicle.engines[i, 1]
            y += lost * vehicle.engines[i, 2]
            z += lost * vehicle.engines[i, 3]
            any_failed |= failed
        per = 1.0 / remaining if remaining > 1e-12 else 0.0
        Z[s.ENGINE_ARM, lane] = per * x
        Z[s.ENGINE_ARM + 1, lane] = per * y
        Z[s.ENGINE_ARM + 2, lane] = per * z
        Z[s.ENGINE_THRUST, lane] = (Z[s.ENGINE_THRUST, lane] if engine_fails else 1.0) * remaining
        Z[s.ENGINE_FAILED, lane] = (
            1.0 if any_failed else (Z[s.ENGINE_FAILED, lane] if engine_fails else 0.0)
        )


@lanes
def watch_inlet(Z, width, inlet, time):
    """Update whether the inlet is unstarted; this takes effect at the next tick.

    The inlet restarts after the flow has been within its range for the restart delay.
    """
    for lane in range(width):
        alpha = Z[s.V_ALPHA, lane]
        beta = Z[s.V_BETA, lane]
        mach = Z[s.V_MACH, lane]
        inside = (
            inlet.angle_of_attack_min <= alpha <= inlet.angle_of_attack_max
            and abs(beta) <= inlet.sideslip_max
        )
        inside = inside and inlet.mach_min <= mach <= inlet.mach_max
        last = Z[s.UNSTART_TIME, lane] if inside else time
        over = time - last >= inlet.restart_delay - _SAME_TIME
        before = Z[s.UNSTARTED, lane]
        Z[s.UNSTART_TIME, lane] = last
        Z[s.UNSTARTED, lane] = (0.0 if over else before) if inside else 1.0
