"""Replay, by compiled code, of flights recorded by other simulators."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.timing import Timing
from abhv_mc.io.foreign_table import read_foreign_table
from abhv_mc.io.messages import InputError, quoted
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.plan import FlightPlan, Limits
from abhv_mc_vehicle.kernel.laws.columns import RECORDED_GAINS, REFERENCE
from abhv_mc_vehicle.kernel.numerics.quaternion import from_euler, rotate_to_body
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.plant.effectiveness import make_effectiveness
from abhv_mc_vehicle.user_code.vehicle_functions import find_code
from abhv_mc_vehicle.vehicle.actuators import drive

if TYPE_CHECKING:
    import pandas as pd

_EVEN = 0.02  # relative tolerance for even spacing, because printed times are rounded
_INF = math.inf
_NO_LIMITS = Limits(-_INF, _INF, -_INF, _INF, _INF)


def read_columns(path: Path, names: Sequence[str], perhaps: Sequence[str] = ()) -> "pd.DataFrame":
    """Read columns of a ``.csv`` or ``.csv.gz`` file.

    Columns in `perhaps` are optional. The first of several columns with the same name is used.
    Raise InputError if the file is invalid.
    """
    import pandas as pd

    table = read_foreign_table(path)
    missing = [name for name in names if name not in table.heads]
    if missing:
        expected = "all columns to be compared"
        raise table.error(None, None, f"the table has no columns {quoted(missing, 'or')}", expected)
    if len(table) < 2:
        raise InputError(path, "found 1 row of numbers", "at least 2 rows")
    columns = [*names, *(name for name in perhaps if name in table.heads)]
    numbers = table.numbers([table.heads.index(name) for name in columns])
    return pd.DataFrame(numbers, columns=columns)


def check_times(path: Path, times: Floats, uniform: bool = False) -> None:
    """Raise InputError unless times increase and, if `uniform`, are evenly spaced."""
    steps = np.diff(times)
    falling = np.flatnonzero(steps <= 0.0)
    if falling.size:
        raise InputError(
            path,
            f"the time {times[falling[0] + 1]:g} s is out of order",
            "increasing times",
            int(falling[0]) + 3,
        )
    step = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - step) > _EVEN * step)
    if uniform and off.size:
        problem = f"the row is {steps[off[0]]:g} s after the previous row"
        raise InputError(path, problem, f"evenly spaced rows, {step:g} s apart", int(off[0]) + 3)


def make_start(
    altitude: float,
    velocity_ned: tuple[float, float, float],
    heading: float,
    rates: tuple[float, float, float],
    mass: float,
    *,
    latitude: float = 0.0,
) -> Floats:
    """Return the initial state [state] of a level vehicle at longitude 0 (SI, radians).

    `rates` are inertial body rates.
    """
    x = np.zeros(s.N_STATES)
    x[s.ALTITUDE], x[s.LATITUDE], x[s.MASS] = altitude, latitude, mass
    attitude = from_euler(heading, 0.0, 0.0)
    x[s.Q0 : s.Q3 + 1] = attitude
    x[s.U : s.W + 1] = rotate_to_body(*attitude, *velocity_ned)
    x[s.ROLL_RATE : s.YAW_RATE + 1] = rates
    return x


def make_replay_plan(
    vehicle: Vehicle, earth: Earth, start: Floats, controls: Floats, timing: Timing
) -> FlightPlan:
    """Return a plan with prescribed controls, without a controller or limits.

    `controls` [tick, 4] are the surfaces (rad) and the equivalence ratio, linear between ticks.
    """
    ticks = timing.ticks + 1
    gains = np.zeros((ticks, len(RECORDED_GAINS)))
    gains[:, :4] = controls
    gains[:-1, 4:] = np.diff(controls, axis=0) / timing.tick
    vehicle = drive(vehicle, False)
    return FlightPlan(
        controller="recorded",
        law="recorded",
        vehicle=vehicle,
        trim_tables=vehicle.tables,  # Without guidance, trim tables are not used.
        effectiveness=make_effectiveness(vehicle),
        earth=earth,
        timing=timing,
        limits=_NO_LIMITS,
        initial_state=start,
        reference=np.zeros((ticks, len(REFERENCE))),
        gains=gains,
        settings=np.zeros(1),
        vehicle_code=find_code(vehicle),
    )


def replay(plan: FlightPlan, parameters: Floats | None = None) -> Floats:
    """Simulate one flight and return its states [tick, state]."""
    flown = nominal_parameters() if parameters is None else parameters[np.newaxis]
    return fly(plan, flown, record_every=1, keep_states=True).states[0]


@dataclass(frozen=True)
class Motion:
    """Motion [time] in quantities published by other simulators, in SI units and radians."""

    altitude: Floats  # [time]
    longitude: Floats
    latitude: Floats
    velocity_ned: Floats  # [time, 3]
    euler: Floats  # [time, 3] yaw, pitch, roll
    rates: Floats  # [time, 3] inertial body rates
    mass: Floats


def make_motion(states: Floats) -> Motion:
    """Convert states [time, state] to published quantities."""
    from scipy.spatial.transform import Rotation

    attitude = Rotation.from_quat(states[:, s.Q0 : s.Q3 + 1], scalar_first=True)
    return Motion(
        altitude=states[:, s.ALTITUDE],
        longitude=states[:, s.LONGITUDE],
        latitude=states[:, s.LATITUDE],
        velocity_ned=attitude.apply(states[:, s.U : s.W + 1]),
        euler=attitude.as_euler("ZYX"),
        rates=states[:, s.ROLL_RATE : s.YAW_RATE + 1],
        mass=states[:, s.MASS],
    )


def at_times(tick: float, states: Floats, times: Floats) -> Floats:
    """Interpolate states [time, state] at arbitrary times with a cubic spline."""
    from scipy.interpolate import CubicSpline

    states = states.copy()
    # The longitude is made continuous across the date line.
    states[:, s.LONGITUDE] = np.unwrap(states[:, s.LONGITUDE])
    spline = CubicSpline(tick * np.arange(len(states)), states, axis=0)
    return np.asarray(spline(times), dtype=np.float64)


def wrap_degrees(differences: Floats) -> Floats:
    """Return differences between angles, wrapped to +-180 deg."""
    return np.remainder(differences + 180.0, 360.0) - 180.0
