"""Linearization of the closed loop about points of flights as a sampled system.

Sensors have lags and sampled values as states, and scale factors.

The plant is continuous in path coordinates. The actuators of surfaces and engine are modelled
without limits, dead zones and backlash. The zero-order hold over the control period is modelled
exactly. The controller is represented by the derivatives of its compiled tick, including its
memory. The first dimension of arrays is the point.

The sensor effects have the same order as in :mod:`abhv_mc_vehicle.kernel.flight.sensors`. A delay
commutes with a lag, and shifts the ticks at which a sampled measurement changes.
"""

import math
from collections.abc import Sequence

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.io.messages import InputError, counted
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.flight.sensors import MAX_DELAY_TICKS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.actuator_step import BANDWIDTH, DAMPING, FIRST_ORDER, IDEAL, KIND
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ALL_SENSORS,
    MAX_EFFECTORS,
    NEVER,
    PARAMETER_INDEX,
    SCALED_SENSORS,
)
from abhv_mc_vehicle.stability import path_coordinates as path
from abhv_mc_vehicle.stability.margins import NO_EFFECT, STUCK, Linear
from abhv_mc_vehicle.stability.point_slopes import LONGEST, Points, law_phases, plant_slopes
from abhv_mc_vehicle.stability.probe import (
    INPUTS,
    held_at,
    mix_matrix,
    mixes,
    name_inputs,
    sticks_here,
)
from abhv_mc_vehicle.vehicle.actuators import surface_list

_LAG, _INTERVAL = (
    np.array([PARAMETER_INDEX[f"sensor.{name}_{error}"] for name in ALL_SENSORS])
    for error in ("lag", "interval")
)


def sensor_ticks(plan: FlightPlan, parameters: Floats) -> Ints:
    """Return the number of control periods between sensor samples [point, measured]."""
    ticks = parameters[:, _INTERVAL[: measured_count(plan)]] / plan.timing.tick + 0.5
    return np.maximum(ticks.astype(np.int64), 1)


def _sensors(plan: FlightPlan, points: Points) -> tuple[Floats, Floats, Ints, Ints, Ints]:
    """Return parameters, lags, sample periods, and the indices of lagged and sampled sensors.

    Lags [point, ...] are in control periods, sample periods [point, ...] in ticks.
    """
    parameters = points.lane[:, s.P : s.P + s.N_PARAMETERS]
    lag = np.maximum(parameters[:, _LAG[: measured_count(plan)]], 0.0) / plan.timing.tick
    ticks = sensor_ticks(plan, parameters)
    return (
        parameters,
        lag,
        ticks,
        np.flatnonzero((lag > 0.0).any(axis=0)),
        np.flatnonzero((ticks > 1).any(axis=0)),
    )


def sensor_states(plan: FlightPlan, points: Points) -> list[str]:
    """Return the names of the states that sensors add to the controller's memory."""
    _, _, _, late, sampled = _sensors(plan, points)
    return [f"{ALL_SENSORS[i]}_late" for i in late] + [f"{ALL_SENSORS[i]}_held" for i in sampled]


def repeats_after(ticks: Ints, law: int) -> int:
    """Return the common period of the sensors [measured] and the controller, in ticks.

    Raise InputError if this period exceeds LONGEST.
    """
    count = math.lcm(law, *ticks.tolist())
    if count > LONGEST:
        raise InputError(
            "sensor intervals",
            f"the common period of the sensors and the controller is {counted(count, 'tick')}",
            f"at most {LONGEST} ticks, as margins and linear models require",
        )
    return count


def add_sensors(plan: FlightPlan, points: Points, phases: tuple[Linear, ...]) -> tuple[Linear, ...]:
    """Return the model, including the sensors, of each tick in the common period.

    Raise InputError if sample periods differ between flights or the period is too long.
    """
    parameters, lag, ticks, late, sampled = _sensors(plan, points)
    scale = np.ones_like(lag)
    for name in SCALED_SENSORS:
        if (i := ALL_SENSORS.index(name)) < scale.shape[1]:
            scale[:, i] = parameters[:, PARAMETER_INDEX[f"sensor.{name}_scale"]]
    if not late.size and not sampled.size and (scale == 1.0).all():
        return phases
    if (ticks != ticks[0]).any():
        raise InputError(
            "sensor intervals",
            "the intervals differ between flights",
            "equal intervals, to linearize flights together",
        )
    first = max(points.tick, 1)
    models = []
    for tick in range(first, first + repeats_after(ticks[0], len(phases))):
        law = phases[(tick - first) % len(phases)]
        fresh = (tick - law.delay[:, None]) % ticks == 0
        A, B, C, D = _sense(lag, np.where(fresh, scale, 0.0), fresh, late, sampled)
        none = np.zeros((len(A), A.shape[1], law.law_A.shape[1]))
        models.append(
            law._replace(
                law_A=np.block([[law.law_A, law.law_B @ C], [none, A]]),
                law_B=np.concatenate([law.law_B @ D, B], axis=1),
                law_C=np.concatenate([law.law_C, law.law_D @ C], axis=2),
                law_D=law.law_D @ D,
            )
        )
    return tuple(models)


def _sense(
    lag: Floats, scale: Floats, fresh: Ints, late: Ints, sampled: Ints
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return A, B, C, D [point, ...] of the sensors in a tick, from truth to measurement.

    The states are those of the `late` sensors, followed by those of the `sampled` sensors. `lag`
    [point, measured] is in control periods; `scale` is zero if the last sample is held (not
    `fresh`).
    """
    with np.errstate(divide="ignore"):
        stays = np.where(lag > 0.0, np.exp(-1.0 / lag), 0.0)
    at_once = 1.0 - (1.0 - stays) * lag
    later = stays * at_once + (1.0 - stays) * lag - stays
    points, measured = lag.shape
    m = late.size + sampled.size
    measurements = np.arange(measured)
    A = np.zeros((points, m, m))
    B = np.zeros((points, m, measured))
    C = np.zeros((points, measured, m))
    D = np.zeros((points, measured, measured))
    D[:, measurements, measurements] = scale * at_once
    states = np.arange(late.size)
    samples = late.size + np.arange(sampled.size)
    A[:, states, states] = stays[:, late]
    B[:, states, late] = later[:, late]
    C[:, late, states] = scale[:, late]
    C[:, sampled, samples] = ~fresh[:, sampled]
    A[:, samples] = C[:, sampled]
    B[:, samples] = D[:, sampled]
    return A, B, C, D


_N_PATH = len(path.COORDINATES)
# first row of the measurement in the result of plant_slopes
_MEASURED = _N_PATH + 1
_WHOLE = 1e-7  # largest distance to an integer at which a measurement slope is rounded to it
_AT_ONCE = 1e5  # bandwidth, rad/s, that represents an ideal actuator (damping 1, 0.02 ms delay)
# magnitude below which the slope of a rate with respect to a control is a rounding error
_FELT = 1e-8


def linearize(plan: FlightPlan, points: Points, held: Sequence[int] = ()) -> Linear:
    """Return linear models at points of flights.

    The path coordinates in `held` are constant and are not states of A and B; their rates in the
    continuous plant are zero.
    """
    plant = plant_slopes(plan, points)
    m = points.memory.shape[1]
    n = points.measured.shape[1]
    k = points.controls.shape[1]
    # rows and columns of the path coordinates and custom states, without sideslip, measurements and
    # controls
    rates = [*range(_N_PATH), *range(_MEASURED + n, plant.slope.shape[1])]
    moved = [*range(_N_PATH), *range(_N_PATH + k, plant.slope.shape[2])]
    driven = slice(_N_PATH, _N_PATH + k)
    plant_A = plant.slope[:, rates][:, :, moved]
    plant_B = plant.slope[:, rates, driven]
    held_B = np.zeros_like(plant_B)
    if (points.lane[:, s.SLOW_EFFECTOR : s.SLOW_EFFECTOR + MAX_EFFECTORS] != NEVER).any():
        held_B = plant_slopes(plan, points, hold_slow=True).slope[:, rates, driven] - plant_B
    for matrix in (plant_A, plant_B, held_B):
        matrix[:, list(held)] = 0.0
    A, B = hold(plan, points.lane, plant_A, plant_B, held_B)
    felt = np.abs(plant_B).max(axis=1) + np.abs(held_B).max(axis=1)
    cut = np.where(felt < _FELT, NO_EFFECT, 0)
    stuck = held_at(plan.vehicle, points.lane) != NEVER
    sticks = sticks_here(plan.vehicle, points.lane)
    cut[:, :-1][stuck] = STUCK
    for i in range(stuck.shape[1]):
        B[stuck[:, i], :, i] = 0.0
        # The rate of a stuck input is set to zero at every tick.
        A[sticks[:, i], :, 11 + 2 * i] = 0.0
    sense = _sensing(plant.slope[:, _MEASURED : _MEASURED + n], k)
    A = np.delete(np.delete(A, held, 1), held, 2)
    B = np.delete(B, held, 1)
    age = (points.lane[:, s.parameter_row("sensor.delay")] / plan.timing.tick + 0.5).astype(
        np.int64
    )
    phases = tuple(
        Linear(
            period=plan.timing.tick,
            plant_A=plant_A,
            plant_B=plant_B,
            A=A,
            B=B,
            law_A=law.slope[:, :m, n:],
            law_B=law.slope[:, :m, :n],
            law_C=law.slope[:, m:, n:],
            law_D=law.slope[:, m:, :n],
            delay=np.minimum(age, MAX_DELAY_TICKS),
            sense=np.delete(sense, held, 2),
            cut=cut,
            inputs=name_inputs(plan.vehicle),
        )
        for law in law_phases(plan, points)
    )
    phases = add_sensors(plan, points, phases)
    model = phases[0]._replace(phases=phases if len(phases) > 1 else ())
    if not mixes(plan):
        return model
    axes = tuple(_mixed(phase, mix_matrix(plan.vehicle)) for phase in phases)
    return axes[0]._replace(phases=axes if len(phases) > 1 else (), apart=model)


def _mixed(linear: Linear, mix: Floats) -> Linear:
    """Return the model with axes as inputs; `mix` [effector, axis] maps axes to effectors."""
    inverse_mix = np.linalg.pinv(mix)
    moves = linear.cut == 0
    felt = (moves[:, :, None] & (mix != 0.0)).any(axis=1)
    stuck = ((linear.cut == STUCK)[:, :, None] & (mix != 0.0)).any(axis=1)
    cut = np.where(felt, 0, np.where(stuck, STUCK, NO_EFFECT))
    law_C = inverse_mix @ linear.law_C
    law_D = inverse_mix @ linear.law_D
    return linear._replace(B=linear.B @ mix, law_C=law_C, law_D=law_D, cut=cut, inputs=INPUTS)


def _sensing(slope: Floats, inputs: int) -> Floats:
    """Return the matrix that maps the plant's states to the measurement.

    `slope` has shape [point, measured, 10 + input + custom state]; values close to an integer are
    rounded.
    """
    rounded = np.round(slope)
    clean = np.where(np.abs(slope - rounded) < _WHOLE, rounded, slope)
    last = 10 + 2 * inputs
    sense = np.zeros((*slope.shape[:2], slope.shape[2] + inputs))
    sense[:, :, :10] = clean[:, :, :10]
    sense[:, :, 10:last:2] = clean[:, :, 10 : 10 + inputs]
    sense[:, :, last:] = clean[:, :, 10 + inputs :]
    return sense


def actuator_matrices(plan: FlightPlan, lane: Floats) -> tuple[Floats, Floats]:
    """Return A [point, 2 k, 2 k] and B [point, 2 k, k] of k actuators (position and rate).

    `lane` [point, row] is the kernel's memory.
    """
    actuators = plan.vehicle.actuators[surface_list(plan.vehicle)]
    k = len(actuators)
    A = np.zeros((len(lane), 2 * k, 2 * k))
    B = np.zeros((len(lane), 2 * k, k))
    for i, (bandwidth, damping, kind) in enumerate(actuators[:, [BANDWIDTH, DAMPING, KIND]]):
        ideal = kind == IDEAL
        group = "actuator" if i < k - 1 else "engine"
        w = _AT_ONCE if ideal else bandwidth * lane[:, s.parameter_row(f"{group}.bandwidth")]
        zeta = 1.0 if ideal else damping * lane[:, s.parameter_row(f"{group}.damping")]
        position = 2 * i
        rate = position + 1
        if kind == FIRST_ORDER:  # The rate state follows the actual rate almost instantly.
            A[:, position, position] = -w
            B[:, position, i] = w
            A[:, rate, position] = -_AT_ONCE * w
            A[:, rate, rate] = -_AT_ONCE
            B[:, rate, i] = _AT_ONCE * w
            continue
        A[:, position, rate] = 1.0
        A[:, rate, position] = -(w**2)
        A[:, rate, rate] = -2.0 * zeta * w
        B[:, rate, i] = w**2
    return A, B


def hold(
    plan: FlightPlan, lane: Floats, plant_A: Floats, plant_B: Floats, held_B: Floats
) -> tuple[Floats, Floats]:
    """Return the discrete matrices of plant and actuators, with commands held over a tick.

    `held_B` is the effect of positions that are held over the tick.
    """
    from scipy.linalg import expm

    actuator_A, actuator_B = actuator_matrices(plan, lane)
    last = 10 + actuator_A.shape[1]
    k = actuator_B.shape[2]
    n = last + plant_A.shape[1] - 10
    size = n + (2 * k if held_B.any() else k)
    moved = np.array([*range(10), *range(last, n)])
    together = np.zeros((len(plant_A), size, size))
    together[:, moved[:, None], moved] = plant_A
    together[:, moved, 10:last:2] = plant_B
    together[:, 10:last, 10:last] = actuator_A
    together[:, 10:last, n : n + k] = actuator_B
    together[:, moved, n + k :] = held_B[:, :, : size - n - k]
    # Scaling the rates by the bandwidth keeps the argument of the matrix exponential small.
    scale = np.ones((len(plant_A), size))
    scale[:, 11:last:2] = np.sqrt(actuator_B[:, 1::2].sum(axis=-1))
    balanced = together * scale[:, None, :] / scale[:, :, None]
    end = expm(plan.timing.tick * balanced) * scale[:, :, None] / scale[:, None, :]
    end[:, :n, 10:last:2][:, :, : size - n - k] += end[:, :n, n + k :]
    return np.ascontiguousarray(end[:, :n, :n]), np.ascontiguousarray(end[:, :n, n : n + k])


def open_loop(linear: Linear, point: int) -> tuple[Floats, Floats, Floats]:
    """Return A, B, C from plant inputs to the negated commands, with all loops cut.

    The states are those of the plant, the controller and the delayed measurements.
    """
    m = linear.law_A.shape[1]
    d = int(linear.delay[point])
    sense = linear.sense[point]
    measured, p = sense.shape
    end = p + m  # index after the controller's states
    n = end + measured * d
    # matrix that maps the state of the open loop to the measurement used by the controller
    seen = np.zeros((measured, n))
    if d:
        seen[:, n - measured :] = np.eye(measured)
    else:
        seen[:, :p] = sense
    A = np.zeros((n, n))
    B = np.zeros((n, linear.B.shape[2]))
    A[:p, :p] = linear.A[point]
    B[:p] = linear.B[point]
    A[p:end] = linear.law_B[point] @ seen
    A[p:end, p:end] += linear.law_A[point]
    if d:
        A[end : end + measured, :p] = sense
        A[end + measured :, end : n - measured] = np.eye(measured * (d - 1))
    C = -linear.law_D[point] @ seen
    C[:, p:end] -= linear.law_C[point]
    return A, B, C


def closed_loop(linear: Linear, point: int) -> Floats:
    """Return the closed-loop matrix over one tick, for the states of :func:`open_loop`."""
    A, B, C = open_loop(linear, point)
    return A - B @ C


def closed_period(linear: Linear, point: int) -> Floats:
    """Return the closed-loop matrix over the controller's period, the product over its ticks."""
    maps = [closed_loop(phase, point) for phase in linear.phases or (linear,)]
    return maps[0] if len(maps) == 1 else np.linalg.multi_dot(maps[::-1])
