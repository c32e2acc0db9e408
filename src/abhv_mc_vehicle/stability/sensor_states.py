"""Sensor dynamics in linear models: lags and sampled values as states, and scale factors.

The sensor effects have the same order as in :mod:`abhv_mc_vehicle.kernel.flight.sensors`. A delay
commutes with a lag, and shifts the ticks at which a sampled measurement changes.
"""

import math

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.io.input_error import InputError
from abhv_mc.io.phrases import counted
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.user_law import measured_count
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.parameter_names import (
    ALL_SENSORS,
    PARAMETER_INDEX,
    SCALED_SENSORS,
)
from abhv_mc_vehicle.stability.linear_model import Linear
from abhv_mc_vehicle.stability.periods import LONGEST
from abhv_mc_vehicle.stability.point_slopes import Points

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
        problem = f"the common period of the sensors and the controller is {counted(count, 'tick')}"
        raise InputError(
            "sensor intervals",
            problem,
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
    first, models = max(points.tick, 1), []
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
    m, measurements = late.size + sampled.size, np.arange(measured)
    A, B = np.zeros((points, m, m)), np.zeros((points, m, measured))
    C, D = np.zeros((points, measured, m)), np.zeros((points, measured, measured))
    D[:, measurements, measurements] = scale * at_once
    states, samples = np.arange(late.size), late.size + np.arange(sampled.size)
    A[:, states, states], B[:, states, late] = stays[:, late], later[:, late]
    C[:, late, states] = scale[:, late]
    C[:, sampled, samples] = ~fresh[:, sampled]
    A[:, samples], B[:, samples] = C[:, sampled], D[:, sampled]
    return A, B, C, D
