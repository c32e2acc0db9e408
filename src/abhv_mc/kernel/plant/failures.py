"""Failures of surfaces, engine and sensors at a control tick: from the flight's parameters to what the plant reads.

A flight whose failure times are all infinite gets exact ones and zeros and its own commands, which leave its bits
unchanged. A failure acts from the first control tick at or after its time.
"""

from typing import NamedTuple

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.numerics.angles import clamp
from abhv_mc.kernel.numerics.lane_math import exp
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.actuator_step import BANDWIDTH, DAMPING, ENGINE, IDEAL, KIND, RATE_LIMIT
from abhv_mc.kernel.plant.actuators import COMMAND, MOVES, N_EFFECTOR_ROWS, POSITION, SLOWED
from abhv_mc.kernel.plant.disturbance import any_lane
from abhv_mc.kernel.plant.effectors import command_effectors
from abhv_mc.kernel.plant.parameter_names import AXES, EFFECTORS, ENGINES, FAILURE_TIMES, NEVER
from abhv_mc.kernel.plant.state import XS, X, parameter_row, parameter_rows
from abhv_mc.kernel.plant.vehicle import MAX_ACTUATORS

N_AXES, N_EFFECTORS, N_ENGINES = len(AXES), len(EFFECTORS), len(ENGINES)
_N_FIRST = 4  # effectors whose failures stand in a block of their own
_SAME_TIME = 1e-9  # s: a tick that close before a failure's time is at it

_TIMES = parameter_row(FAILURE_TIMES[0])  # three of each surface and effector: stuck, loss, slow
_EFFECTOR_TIMES = parameter_row(f"failure.{EFFECTORS[0]}.stuck_time")
_ENGINE_TIME = parameter_row("failure.engine.time")
_SENSOR_TIMES = parameter_row("failure.sensor.altitude.time")
_HOW = parameter_row(
    "failure.aileron.stuck_at"
)  # three of each: stuck_at, effectiveness, rate_limit
_EFFECTOR_HOW = parameter_row(f"failure.{EFFECTORS[0]}.stuck_at")
_MORE_TIMES = parameter_row(f"failure.{EFFECTORS[_N_FIRST]}.stuck_time")
_MORE_HOW = parameter_row(f"failure.{EFFECTORS[_N_FIRST]}.stuck_at")
_ENGINE_TIMES, _ENGINE_DURATION, _ENGINE_FACTOR = (
    parameter_row(f"failure.{ENGINES[0]}.{name}") for name in ("time", "duration", "thrust")
)
_DURATION, _THRUST, _DRAG, _PITCH = parameter_rows("failure.engine.duration", 4)
_BIAS = parameter_row("failure.sensor.altitude.bias")
_EFFECTIVENESS = parameter_row("control.aileron_effectiveness")
_EFFECTOR_EFFECTIVENESS = parameter_row(f"control.{EFFECTORS[0]}_effectiveness")


class Failures(NamedTuple):
    """Failures that any lane has in its flight; the others are never computed."""

    surfaces: bool
    effectors: bool
    engine: bool
    engines: bool  # single ones of several
    sensors: bool


@lanes
def possible_failures(Z, width, constants):
    """From the parameters, which are constant over a flight, and whether the vehicle's inlet may unstart."""
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
    """Nothing has failed; call it when the flight's parameters stand in the lane."""
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
    """Measurements that have failed: what they were at the tick before, or off by the bias that the flight gives."""
    for i in range(s.N_MEASURED):
        for lane in range(width):
            failed = time >= Z[_SENSOR_TIMES + i, lane] - _SAME_TIME
            measured, bias = Z[s.MEASURED + i, lane], Z[_BIAS + i, lane]
            frozen = Z[s.FROZEN + i, lane] if failed and time > 0.0 else measured
            Z[s.FROZEN + i, lane] = frozen
            Z[s.MEASURED + i, lane] = (
                (measured + bias if bias != 0.0 else frozen) if failed else measured
            )


@lanes
def fail_plant(Z, A, width, failures, vehicle, time, tick):
    """Commands as the actuators get them, and the factors and increments of the tick that begins at ``time`` (s).

    ``tick`` is its length. Call it when the control law's commands have been passed on.
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
def hold_stuck(Z, lane, row, asked, at, stuck):
    """Where a stuck surface is: where it is ``asked`` to, else where it was ``at`` first, which ``row`` remembers."""
    held = Z[row, lane]
    held = (at if held == NEVER else held) if asked == NEVER else asked
    Z[row, lane] = held if stuck else NEVER
    return held


@lanes
def fail_surfaces(Z, width, actuators, time):
    """Aileron, rudder and elevator.

    A surface that sticks where it is stops there at once; one that sticks elsewhere is driven there by its actuator.
    """
    for i in range(N_AXES):
        for lane in range(width):
            stuck, lost, slow = has_failed(Z, lane, _TIMES + 3 * i, time)
            factor = Z[_HOW + 3 * i + 2, lane] if slow else 1.0
            Z[s.EFFECT + i, lane] = Z[_EFFECTIVENESS + i, lane] * (
                Z[_HOW + 3 * i + 1, lane] if lost else 1.0
            )
            Z[s.RATE_FACTOR + i, lane] = factor
            fastest = actuators[i, RATE_LIMIT] * Z[s.K_RATE, lane] * factor
            rate = Z[X + s.AILERON_RATE + i, lane]
            rate = clamp(rate, -fastest, fastest) if slow else rate
            asked = Z[_HOW + 3 * i, lane]
            held = hold_stuck(
                Z, lane, s.STUCK_SURFACE + i, asked, Z[X + s.AILERON + i, lane], stuck
            )
            Z[s.ACTUATED + i, lane] = held if stuck else Z[s.ACTUATED + i, lane]
            Z[X + s.AILERON_RATE + i, lane] = 0.0 if stuck and asked == NEVER else rate
            Z[XS + s.AILERON_RATE + i, lane] = Z[X + s.AILERON_RATE + i, lane]


@lanes
def fail_driven_effector(Z, A, width, e, time):
    """One that has an actuator of its own, as :func:`fail_surfaces` does it for the axes."""
    first = e * N_EFFECTOR_ROWS
    times, how = failure_rows(e)
    for lane in range(width):
        stuck, lost, slow = has_failed(Z, lane, times, time)
        held = hold_stuck(
            Z, lane, s.STUCK_EFFECTOR + e, Z[how, lane], A[first + POSITION, lane], stuck
        )
        A[first + COMMAND, lane] = held if stuck else A[first + COMMAND, lane]
        A[first + MOVES, lane] = 0.0 if stuck and Z[how, lane] == NEVER else A[first + MOVES, lane]
        A[first + SLOWED, lane] *= Z[how + 2, lane] if slow else 1.0
        Z[s.EFFECTOR_GAIN + e, lane] = Z[_EFFECTOR_EFFECTIVENESS + e, lane] * (
            Z[how + 1, lane] if lost else 1.0
        )
        Z[s.EFFECTOR_OFFSET + e, lane] = 0.0


@lanes
def failure_rows(e):
    """First rows of an effector's three times, and of how it fails."""
    if e < _N_FIRST:
        return _EFFECTOR_TIMES + 3 * e, _EFFECTOR_HOW + 3 * e
    return _MORE_TIMES + 3 * (e - _N_FIRST), _MORE_HOW + 3 * (e - _N_FIRST)


@lanes
def has_failed(Z, lane, times, time):
    """Whether a surface sticks, has lost effectiveness, is slow."""
    return (
        time >= Z[times, lane] - _SAME_TIME,
        time >= Z[times + 1, lane] - _SAME_TIME,
        time >= Z[times + 2, lane] - _SAME_TIME,
    )


@lanes
def fail_effectors(Z, A, width, vehicle, time, tick):
    """The vehicle's own surfaces, which the three axis deflections are mixed to.

    A slow one follows its mix no faster than the surfaces' rate limit allows, and is held over the tick.
    """
    constants, mix = vehicle.constants, vehicle.effector_mix
    fastest = vehicle.actuators[0, RATE_LIMIT]
    for e in range(mix.shape[0]):
        if constants.driven > 0.0:
            fail_driven_effector(Z, A, width, e, time)
            continue
        times, how = failure_rows(e)
        reach = abs(mix[e, 0]) + abs(mix[e, 1]) + abs(mix[e, 2])
        for lane in range(width):
            mixed = 0.0
            for i in range(N_AXES):
                mixed += mix[e, i] * (Z[s.EFFECT + i, lane] * Z[X + s.AILERON + i, lane])
            stuck, lost, slow = has_failed(Z, lane, times, time)
            factor = Z[how + 2, lane]
            farthest = fastest * Z[s.K_RATE, lane] * factor * reach * tick
            last = Z[s.SLOW_EFFECTOR + e, lane]
            near = mixed if last == NEVER else clamp(mixed, last - farthest, last + farthest)
            Z[s.SLOW_EFFECTOR + e, lane] = near if slow else NEVER
            gain = Z[_EFFECTOR_EFFECTIVENESS + e, lane] * (Z[how + 1, lane] if lost else 1.0)
            at = gain * (near if slow else mixed)
            held = hold_stuck(Z, lane, s.STUCK_EFFECTOR + e, Z[how, lane], at, stuck)
            Z[s.EFFECTOR_GAIN + e, lane] = 0.0 if stuck or slow else gain
            Z[s.EFFECTOR_OFFSET + e, lane] = held if stuck else (gain * near if slow else 0.0)


@lanes
def settle(value, aim, lag, tick):
    """A first-order answer to ``aim``: what a value is at the end of a tick, and its mean over the tick."""
    kept = exp(-tick / lag) if lag > 0.0 else 0.0
    return aim + kept * (value - aim), aim + (1.0 - kept) * (lag / tick) * (value - aim)


@lanes
def engine_lag(Z, lane, actuators):
    """Time constant of the engine's own answer, s."""
    damping = actuators[ENGINE, DAMPING] * Z[s.K_ENGINE_DAMPING, lane]
    return 2.0 * damping / (actuators[ENGINE, BANDWIDTH] * Z[s.K_ENGINE_BANDWIDTH, lane])


@lanes
def fails_now(Z, lane, time, begin, duration):
    """Whether ``time`` is within a failure of an engine, of which rows give time and duration."""
    since = time - Z[begin, lane]
    return since >= -_SAME_TIME and since < Z[duration, lane] - _SAME_TIME


@lanes
def fail_engine(Z, width, vehicle, time, tick):
    """Thrust, drag and pitching moment of an engine that has failed, at its time or by its inlet's condition.

    Its thrust decays with the engine's own lag; it relights after a delay, and comes back with a time constant.
    """
    constants, inlet = vehicle.constants, vehicle.constants.inlet
    ideal = vehicle.actuators[ENGINE, KIND] == IDEAL
    for lane in range(width):
        lag, unstarted = engine_lag(Z, lane, vehicle.actuators), Z[s.UNSTARTED, lane] > 0.0
        failed = fails_now(Z, lane, time, _ENGINE_TIME, _DURATION) or unstarted
        last = time if failed else Z[s.FAILED_TIME, lane]
        out = time - last < constants.relight_delay - _SAME_TIME
        before, aim = Z[s.ENGINE_WHOLE, lane], Z[_THRUST, lane] if failed or out else 1.0
        slow = (
            constants.relight_time_constant
            if aim > before and constants.relight_time_constant > 0.0
            else lag
        )
        at_once = ideal and slow == lag
        Z[s.ENGINE_WHOLE, lane], Z[s.ENGINE_THRUST, lane] = settle(
            before, aim, 0.0 if at_once else slow, tick
        )
        Z[s.FAILED_TIME, lane] = last
        Z[s.ENGINE_DRAG, lane] = (Z[_DRAG, lane] if failed else 0.0) + (
            inlet.drag_increment if unstarted else 0.0
        )
        pitch = inlet.pitching_moment_increment if unstarted else 0.0
        Z[s.ENGINE_PITCH, lane] = (Z[_PITCH, lane] if failed else 0.0) + pitch
        Z[s.ENGINE_FAILED, lane] = 1.0 if failed else 0.0


@lanes
def fail_engines(Z, width, vehicle, whole_fails, time, tick):
    """Single engines of several: less thrust, which acts off the line of the whole.

    Each decays, and comes back, with the engine's own lag. ``whole_fails``: :func:`fail_engine` has run.
    """
    ideal = vehicle.actuators[ENGINE, KIND] == IDEAL
    for lane in range(width):
        lag = 0.0 if ideal else engine_lag(Z, lane, vehicle.actuators)
        left, x, y, z, some = 1.0, 0.0, 0.0, 0.0, False
        for i in range(vehicle.engines.shape[0]):
            failed = fails_now(Z, lane, time, _ENGINE_TIMES + i, _ENGINE_DURATION + i)
            aim = Z[_ENGINE_FACTOR + i, lane] if failed else 1.0
            Z[s.ENGINE_RUNS + i, lane], mean = settle(Z[s.ENGINE_RUNS + i, lane], aim, lag, tick)
            lost = vehicle.engines[i, 0] * (mean - 1.0)
            left += lost
            x += lost * vehicle.engines[i, 1]
            y += lost * vehicle.engines[i, 2]
            z += lost * vehicle.engines[i, 3]
            some |= failed
        per = 1.0 / left if left > 1e-12 else 0.0
        Z[s.ENGINE_ARM, lane], Z[s.ENGINE_ARM + 1, lane], Z[s.ENGINE_ARM + 2, lane] = (
            per * x,
            per * y,
            per * z,
        )
        Z[s.ENGINE_THRUST, lane] = (Z[s.ENGINE_THRUST, lane] if whole_fails else 1.0) * left
        Z[s.ENGINE_FAILED, lane] = (
            1.0 if some else (Z[s.ENGINE_FAILED, lane] if whole_fails else 0.0)
        )


@lanes
def watch_inlet(Z, width, inlet, time):
    """Whether the flow at the tick's air data leaves the inlet started; what follows acts from the next tick on.

    It starts again when the flow has been inside its range for the restart delay.
    """
    for lane in range(width):
        alpha, beta, mach = Z[s.V_ALPHA, lane], Z[s.V_BETA, lane], Z[s.V_MACH, lane]
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
