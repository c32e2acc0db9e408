"""Linear models and stability margins of a single flight, as tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from abhv_mc.io.messages import InputError, check_names, joined, quoted
from abhv_mc.io.units import ANGLE, TIME
from abhv_mc.shipped import DEFAULT_VEHICLE
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import prepare, read_law
from abhv_mc_vehicle.one_flight.fly_once import (
    Input,
    Quantity,
    make_document,
    make_flight_plan,
    make_parameters,
    to_si,
)
from abhv_mc_vehicle.stability import linearize as systems
from abhv_mc_vehicle.stability.analysis import (
    GROWTH,
    Stability,
    Time,
    analyse,
    closed_poles,
    cut_loops,
    margin_values,
)
from abhv_mc_vehicle.stability.margins import Linear
from abhv_mc_vehicle.stability.model_file import make_model
from abhv_mc_vehicle.stability.path_coordinates import COORDINATES
from abhv_mc_vehicle.stability.point_slopes import Points, find_period
from abhv_mc_vehicle.stability.points import AT_LIMIT, flown_points, fly_disturbed, near_nodes
from abhv_mc_vehicle.stability.probe import law_memory_rows, plant_states
from abhv_mc_vehicle.stability.steady import make_steady_plan, trim_points
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.actuators import slack_warnings
from abhv_mc_vehicle.vehicle_simulator.make_plans import check_rows

_MARGIN_UNITS = {
    "gain_margin_low_db": "dB",
    "gain_margin_high_db": "dB",
    "phase_margin_deg": "deg",
    "delay_margin_ms": "ms",
    "sensitivity_peak": "-",
    "crossover_rad_s": "rad/s",
    "disk_margin": "-",
    "disk_gain_db": "dB",
    "disk_phase_deg": "deg",
}
_MOST_BANK = 1.4  # maximum bank angle, rad
_FREQUENCIES = 1000
_SLOW = 0.1  # magnitude above which a pole belongs to the attitude motion, 1/s
HELD = ("altitude", "speed", "heading")


class Place(NamedTuple):
    """Linearization point of a flight."""

    plan: FlightPlan  # plan with the reference and gains at the point
    points: Points  # arrays with a single point
    warnings: list[str]


class StateSpace(NamedTuple):
    """Linear system as tables with named rows and columns; ``attrs["units"]`` gives units.

    Attributes
    ----------
    A, B, C, D
        Matrices [state, state], [state, input], [output, state] and [output, input].

    Examples
    --------
    >>> plant = abhv_mc.linearize("level").plant
    >>> list(plant.B.columns)
    ['aileron', 'rudder', 'elevator', 'equivalence_ratio']
    """

    A: pd.DataFrame
    B: pd.DataFrame
    C: pd.DataFrame
    D: pd.DataFrame


@dataclass(frozen=True)
class LinearModel:
    """Linear models of plant, law and loops about a point, in SI units and radians.

    ``control.ss(*model.loop, model.period_s)`` accepts each system. All systems except
    ``plant_continuous`` are sampled once per control period: ``x+ = A x + B u``, ``y = C x + D u``.

    Attributes
    ----------
    plant_continuous
        Continuous plant with path coordinates and actuators, from commands to path coordinates.
    plant
        Sampled plant under held commands.
    law
        Controller, from measurements to commands.
    loop
        Open loop, cut at the actuators, from actuator inputs to minus the commands.
    closed
        Closed loop, from disturbances of the commands to path coordinates and commands.
    period_s, measurement_delay_periods
        Control period, s, and delay of the measurements.
    point
        Values of the states at the point.
    warnings
        Warnings, for example about a table node near the point.

    Examples
    --------
    >>> model = abhv_mc.linearize("level")
    >>> model.plant.A.shape, model.measurement_delay_periods
    ((18, 18), 0)
    """

    plant_continuous: StateSpace
    plant: StateSpace
    law: StateSpace
    loop: StateSpace
    closed: StateSpace
    period_s: float
    measurement_delay_periods: int
    point: pd.Series  # values of the states at the point, with ``attrs["units"]``
    warnings: tuple[str, ...]


def take_point(
    mission: Input,
    vehicle: Input,
    controller: Input,
    at: Quantity = "trim",
    bank: Quantity = 0.0,
    *,
    dispersions: Mapping[str, Quantity] | None = None,
) -> Place:
    """Return a linearization point: a steady turn, or a time of a flight.

    See :func:`abhv_mc.linearize`. Raise InputError if the point does not exist.
    """
    time: Time = "trim" if isinstance(at, str) and at == "trim" else to_si(at, TIME, "at")
    angle = to_si(bank, ANGLE, "bank")
    if angle and time != "trim":
        raise InputError(
            "bank",
            "a bank angle is given",
            "the point 'trim', because other points have their own bank",
        )
    if abs(angle) > _MOST_BANK:
        raise InputError("bank", f"found {angle:g} rad", "-80 to 80 deg")
    law: Any = make_document("control", controller)  # Documents are accepted in place of paths.
    craft: Any = make_document("vehicle", vehicle)
    mission_document: Any = make_document("mission", mission)
    name = law.path.stem
    packed = load_vehicle(craft)
    if packed.constants.surface_limit == 0.0 or packed.constants.equivalence_ratio_max == 0.0:
        raise InputError(
            craft.path,
            "the vehicle has no control surfaces or no engine",
            "a vehicle with both, because controllers require them",
        )
    parameters = make_parameters(dispersions, packed)
    warnings = slack_warnings(packed)
    if time == "trim":
        record, user_code = read_law(law)
        try:
            plan = make_steady_plan(
                packed, read_mission(mission_document), record, name, angle, user_code
            )
            plan = plan.lean_for(dispersions or ())
            points, (fault,) = trim_points(plan, parameters)
        except np.linalg.LinAlgError as error:
            raise InputError(
                craft.path,
                f"the vehicle is not controllable in steady flight ({str(error).lower()})",
                "surfaces with independent moments, and a weight that can be trimmed",
            ) from None
        if fault:
            raise InputError(
                mission_document.path,
                f"at the start, {fault}",
                "an initial condition with a trim, or a time of the flight instead of the trim",
            )
    else:
        plan = prepare(craft, mission_document, law, name).lean_for(dispersions or ())
        if not 0.0 <= time <= plan.timing.duration:
            raise InputError(
                "at", f"found {time:g} s", f"a time of the mission, 0 to {plan.timing.duration:g} s"
            )
        points, (fault,) = flown_points(plan, parameters, time)
        if fault not in ("", AT_LIMIT):
            raise InputError(
                "at",
                f"{time:g} s: {fault}",
                f"a time before the flight of {name} ends, at which derivatives exist",
            )
        if fault:
            warnings.append(f"{name} at {time:g} s: {fault}; the linear model neglects limits")
    check_rows(plan, parameters)
    warnings += [f"{name}: {message}" for message in near_nodes(plan, points)]
    warnings += [
        f"{name}: linearized with the memory value {mode}, which small changes do not affect"
        for mode in find_period(plan).modes
    ]
    return Place(plan, points, warnings)


def analyse_place(location: Place, hold: Sequence[str]) -> tuple[Linear, Stability, list[str]]:
    """Return the linear model at a point, the stability margins, and notes.

    `hold` names slow states that are held constant; the notes list the removed poles. Raise
    InputError for other names.
    """
    check_names("hold", hold, HELD)
    held = [COORDINATES.index(name) for name in hold]
    linear = systems.linearize(location.plan, location.points, held)
    stability = analyse(linear, _FREQUENCIES, apart=True)
    name = location.plan.controller
    notes: list[str] = []
    if held:
        free = closed_poles(systems.linearize(location.plan, location.points))[0]
        left = list(stability.poles[0])
        removed = []
        for pole in free:  # The remaining poles differ slightly from the original poles.
            nearest = int(np.argmin(np.abs(np.array(left) - pole))) if left else -1
            if left and abs(left[nearest] - pole) < 0.2 * abs(pole) + GROWTH:
                left.pop(nearest)
            elif pole.imag >= 0.0:
                turning = f" +- {pole.imag:.2g}j" if pole.imag > 0.0 else ""
                removed.append(f"{pole.real:+.2g}{turning}")
        notes = [
            f"{name}: {quoted(hold)} held constant, which removes the poles at "
            f"{joined(removed)} 1/s"
        ]
    else:
        growing = stability.poles[0][stability.poles[0].real >= GROWTH]
        if growing.size and np.abs(growing).max() < _SLOW:
            notes = [
                f"{name}: the unstable poles are slow and belong to states that the controller may "
                f"not control: hold {quoted(HELD)} to compute the margins of the remaining dynamics"
            ]
    return linear, stability, notes


def linearize(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> LinearModel:
    """Return linear models of plant, law and loops about the trim or a time of a flight.

    ``abhv-mc linearize`` writes the same models.

    Parameters
    ----------
    mission, vehicle, controller, dispersions
        See :func:`abhv_mc.fly`; the code of custom controllers is executed.
    at
        ``trim``, the trim of the true plant at the start of the mission, or a time of the flight
        (s, or text with a unit).
    bank
        Bank angle of the trimmed steady turn (rad, or text with a unit).

    Returns
    -------
    LinearModel
        For a controller with m memory values and a measurement delay of d control periods, A is
        [18, 18] for the plant, [m, m] for the law and [18 + m + 10 d, 18 + m + 10 d] for the loop
        and the closed loop.

    Raises
    ------
    InputError
        If an input is invalid or the point does not exist.

    Examples
    --------
    >>> loop = abhv_mc.linearize("level", "abhv", "tlc", at="30 s").loop
    >>> loop.C.shape[0]
    4
    """
    location = take_point(mission, vehicle, controller, at, bank, dispersions=dispersions)
    model = make_model(
        location.plan, location.points, systems.linearize(location.plan, location.points)
    )
    point = pd.Series(model["point"]["states"], model["plant"]["states"], name="point")
    point.attrs["units"] = dict(
        zip(model["plant"]["states"], model["plant"]["state_units"], strict=True)
    )
    parts = ("plant_continuous", "plant", "law", "loop", "closed")
    return LinearModel(
        **{system: _make_tables(model[system]) for system in parts},
        period_s=model["period_s"],
        measurement_delay_periods=model["measurement_delay_periods"],
        point=point,
        warnings=tuple(location.warnings),
    )


def margins(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    hold: Sequence[str] = (),
    dispersions: Mapping[str, Quantity] | None = None,
) -> pd.DataFrame:
    """Return stability margins, as ``abhv-mc margins`` prints them.

    Parameters
    ----------
    mission, vehicle, controller, at, bank, dispersions
        See :func:`abhv_mc.linearize`.
    hold
        States among ``altitude``, ``speed`` and ``heading`` that are held constant, for a
        controller that does not control these states, such as an attitude hold. A warning gives the
        removed poles.

    Returns
    -------
    pandas.DataFrame
        One row for each loop (``aileron``, ``rudder``, ``elevator``, ``equivalence_ratio``), broken
        at its actuator with all other loops closed, and the row ``all`` for simultaneous
        perturbations of all loops, which has the disk margin. Unlimited margins are infinite.
        Margins are NaN if the closed loop is unstable or the loop does not exist;
        ``attrs["reasons"]`` is then ``stuck`` or ``no effect``. ``attrs`` also has ``units`` by
        column, ``stable``, the ``poles`` of the closed loop (1/s, fastest growing first) and
        ``warnings``.

    Raises
    ------
    InputError
        See :func:`abhv_mc.linearize`.

    Examples
    --------
    >>> table = abhv_mc.margins("level", "abhv", "tlc", at="trim")
    >>> bool(table["gain_margin_high_db"].min() > 6.0)
    True
    """
    location = take_point(mission, vehicle, controller, at, bank, dispersions=dispersions)
    _, stability, notes = analyse_place(location, hold)
    table = pd.DataFrame.from_dict(
        margin_values(stability), orient="index", columns=list(_MARGIN_UNITS)
    )
    table.index.name = "loop"
    table.attrs = {
        "units": dict(_MARGIN_UNITS),
        "stable": bool(stability.stable[0]),
        "poles": stability.poles[0].tolist(),
        "reasons": cut_loops(stability),
        "warnings": [*location.warnings, *notes],
    }
    return table


def fly_on(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    at: Quantity = 0.0,
    *,
    disturbance: Mapping[str, float] | None = None,
    duration: Quantity = 1.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> pd.DataFrame:
    """Continue a flight after a disturbance, for comparison with a linear model.

    Parameters
    ----------
    mission, vehicle, controller, dispersions
        See :func:`abhv_mc.fly`.
    at
        Time of the disturbance (s, or text with a unit).
    disturbance
        Increments of states of ``linearize(...).closed``, by name, in SI units and radians.
    duration
        Duration of the continuation (s, or text with a unit).

    Returns
    -------
    pandas.DataFrame
        States of the closed loop in double precision, except delayed measurements, indexed by time.

    Raises
    ------
    InputError
        See :func:`abhv_mc.linearize`.

    Examples
    --------
    >>> states = abhv_mc.fly_on("level", at="10 s", disturbance={"bank": 0.01}, duration="0.5 s")
    >>> states.index.name
    'time'
    """
    plan = make_flight_plan(mission, vehicle, controller)
    names = [*plant_states(plan.vehicle), *(f"law_{name}" for name in law_memory_rows(plan))]
    change = np.zeros(len(names))
    check_names("disturbance", disturbance or (), names)
    for name, value in (disturbance or {}).items():
        change[names.index(name)] = value
    tick, ticks = (
        round(to_si(time, TIME, word) / plan.timing.tick)
        for time, word in ((at, "at"), (duration, "duration"))
    )
    if not 0 <= tick <= plan.timing.ticks:
        raise InputError(
            "at", f"found {at}", f"a time of the mission, 0 to {plan.timing.duration:g} s"
        )
    parameters = make_parameters(dispersions, plan.vehicle)
    check_rows(plan, parameters)
    states = fly_disturbed(plan, parameters, tick, change, ticks)
    times = (tick + np.arange(len(states))) * plan.timing.tick
    return pd.DataFrame(states, columns=names, index=pd.Index(times, name="time"))


def _make_tables(system: dict[str, Any]) -> StateSpace:
    """Convert a system of :func:`abhv_mc_vehicle.stability.model_file.make_model` to tables."""
    kinds = ("state", "input", "output")
    units = {
        name: unit
        for kind in kinds
        for name, unit in zip(system[f"{kind}s"], system[f"{kind}_units"], strict=True)
        if unit
    }

    def table(name: str, rows: str, columns: str) -> pd.DataFrame:
        frame = pd.DataFrame(system[name], index=system[rows], columns=system[columns])
        frame.attrs["units"] = units
        return frame

    return StateSpace(
        table("A", "states", "states"),
        table("B", "states", "inputs"),
        table("C", "outputs", "states"),
        table("D", "outputs", "inputs"),
    )
