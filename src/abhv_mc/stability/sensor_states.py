"""Sensors in linear models: lags and held samples are states beside the law's memory, a scale factor one of its slopes.

In the order of :mod:`abhv_mc.kernel.flight.sensors`, whose delay commutes with a lag, and moves the ticks at which a
delayed measurement changes.
"""

import math

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.user_law import measured_count
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import ALL_SENSORS, PARAMETER_INDEX, SCALED_SENSORS
from abhv_mc.stability.linear_model import Linear
from abhv_mc.stability.periods import LONGEST
from abhv_mc.stability.point_slopes import Points

_LAG, _INTERVAL, _SCALE = (
    PARAMETER_INDEX[f"sensor.altitude_{what}"] for what in ("lag", "interval", "scale")
)


def sensor_ticks(plan: FlightPlan, parameters: Floats) -> Ints:
    """Control periods between samples [point, measured], of ``parameters`` [point, parameter]."""
    ticks = parameters[:, _INTERVAL : _INTERVAL + measured_count(plan)] / plan.timing.tick + 0.5
    return np.maximum(ticks.astype(np.int64), 1)


def _sensors(plan: FlightPlan, points: Points) -> tuple[Floats, Floats, Ints, Ints, Ints]:
    """Parameters, lags in control periods and ticks between samples [point, ...]; which sensors are late, and held."""
    given = points.lane[:, s.P : s.P + s.N_PARAMETERS]
    lag = np.maximum(given[:, _LAG : _LAG + measured_count(plan)], 0.0) / plan.timing.tick
    ticks = sensor_ticks(plan, given)
    return (
        given,
        lag,
        ticks,
        np.flatnonzero((lag > 0.0).any(axis=0)),
        np.flatnonzero((ticks > 1).any(axis=0)),
    )


def sensor_states(plan: FlightPlan, points: Points) -> list[str]:
    """Names of the states that sensors add to the law's memory."""
    _, _, _, late, held = _sensors(plan, points)
    return [f"{ALL_SENSORS[i]}_late" for i in late] + [f"{ALL_SENSORS[i]}_held" for i in held]


def repeats_after(ticks: Ints, law: int) -> int:
    """Ticks after which sensors [measured] and a law do the same again. Raises InputError for more than LONGEST."""
    count = math.lcm(law, *ticks.tolist())
    if count > LONGEST:
        found = f"samples of sensors and a law that repeat together after {count} ticks"
        raise InputError(
            "sensor intervals", found, f"after at most {LONGEST}, for margins and linear models"
        )
    return count


def add_sensors(plan: FlightPlan, points: Points, phases: tuple[Linear, ...]) -> tuple[Linear, ...]:
    """Models of each tick with what sensors do, until law and samples both repeat. InputError if late."""
    given, lag, ticks, late, held = _sensors(plan, points)
    scale = np.ones_like(lag)
    scaled = [
        i for i, name in enumerate(SCALED_SENSORS) if ALL_SENSORS.index(name) < scale.shape[1]
    ]
    scale[:, [ALL_SENSORS.index(SCALED_SENSORS[i]) for i in scaled]] = given[
        :, [_SCALE + i for i in scaled]
    ]
    if not late.size and not held.size and (scale == 1.0).all():
        return phases
    if (ticks != ticks[0]).any():
        raise InputError(
            "sensor intervals",
            "some that differ between flights",
            "the same, to linearize them together",
        )
    first, found = max(points.tick, 1), []
    for tick in range(first, first + repeats_after(ticks[0], len(phases))):
        law = phases[(tick - first) % len(phases)]
        fresh = (tick - law.delay[:, None]) % ticks == 0
        A, B, C, D = _sense(lag, np.where(fresh, scale, 0.0), fresh, late, held)
        none = np.zeros((len(A), A.shape[1], law.law_A.shape[1]))
        found.append(
            law._replace(
                law_A=np.block([[law.law_A, law.law_B @ C], [none, A]]),
                law_B=np.concatenate([law.law_B @ D, B], axis=1),
                law_C=np.concatenate([law.law_C, law.law_D @ C], axis=2),
                law_D=law.law_D @ D,
            )
        )
    return tuple(found)


def _sense(
    lag: Floats, scale: Floats, fresh: Ints, late: Ints, held: Ints
) -> tuple[Floats, Floats, Floats, Floats]:
    """A, B, C, D [point, ...] of the sensors in a tick, from the truth to what is measured.

    States are of the ``late`` sensors, then of the ``held`` ones. ``lag`` [point, measured] is in control periods;
    ``scale`` is zero where ``fresh`` says that the last sample is held.
    """
    with np.errstate(divide="ignore"):
        stays = np.where(lag > 0.0, np.exp(-1.0 / lag), 0.0)
    at_once = 1.0 - (1.0 - stays) * lag
    later = stays * at_once + (1.0 - stays) * lag - stays
    points, measured = lag.shape
    m, measurements = late.size + held.size, np.arange(measured)
    A, B = np.zeros((points, m, m)), np.zeros((points, m, measured))
    C, D = np.zeros((points, measured, m)), np.zeros((points, measured, measured))
    D[:, measurements, measurements] = scale * at_once
    states, samples = np.arange(late.size), late.size + np.arange(held.size)
    A[:, states, states], B[:, states, late] = stays[:, late], later[:, late]
    C[:, late, states] = scale[:, late]
    C[:, held, samples] = ~fresh[:, held]
    A[:, samples], B[:, samples] = C[:, held], D[:, held]
    return A, B, C, D
