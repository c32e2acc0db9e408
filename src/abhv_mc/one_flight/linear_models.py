"""Linear models and stability margins of one flight, as tables."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from abhv_mc.io.documents import InputError, one_of
from abhv_mc.io.units import ANGLE, TIME
from abhv_mc.one_flight.given import (
    Input,
    Quantity,
    make_document,
    make_flight_plan,
    make_parameters,
    to_si,
)
from abhv_mc.shipped import DEFAULT_VEHICLE

if TYPE_CHECKING:
    import pandas as pd

    from abhv_mc.flight.plan import FlightPlan
    from abhv_mc.stability.analysis import Stability, Time
    from abhv_mc.stability.linear_model import Linear
    from abhv_mc.stability.point_slopes import Points

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
_MOST_BANK = 1.4  # rad
_FREQUENCIES = 1000


class Place(NamedTuple):
    """Where a flight is linearized."""

    plan: "FlightPlan"  # whose reference and gains belong to the point
    points: "Points"  # one
    warnings: list[str]  # where it is doubtful


class StateSpace(NamedTuple):
    """A linear system: tables with the names of states, inputs and outputs, ``attrs["units"]`` by name."""

    A: "pd.DataFrame"  # [state, state]
    B: "pd.DataFrame"  # [state, input]
    C: "pd.DataFrame"  # [output, state]
    D: "pd.DataFrame"  # [output, input]


@dataclass(frozen=True)
class LinearModel:
    """The flight under control about a point, SI and radians. ``control.ss(*model.loop, model.period_s)`` takes a part.

    All parts but ``plant_continuous`` are sampled: ``x+ = A x + B u``, ``y = C x + D u`` once a control period.
    """

    plant_continuous: (
        StateSpace  # path coordinates and actuators; from commands to the path coordinates
    )
    plant: StateSpace  # the same under held commands
    law: StateSpace  # its memory; from the measurement to the commands
    loop: StateSpace  # all loops cut at the actuators: from what goes in there to minus what the law commands
    closed: StateSpace  # from disturbances of the commands to path coordinates and commands
    period_s: float  # of the control
    measurement_delay_periods: int
    point: "pd.Series"  # states at the point; ``attrs["units"]``
    warnings: tuple[str, ...]  # such as that a table's node is near


def take_point(
    mission: Input,
    vehicle: Input,
    controller: Input,
    at: Quantity = "trim",
    bank: Quantity = 0.0,
    *,
    dispersions: Mapping[str, Quantity] | None = None,
) -> Place:
    """The point of one flight: its steady turn, or a time of it; see :func:`abhv_mc.linearize`. Raises InputError."""
    import numpy as np

    from abhv_mc.control.mission import read_mission
    from abhv_mc.flight.prepare import prepare, read_law
    from abhv_mc.simulators.make_plans import check_rows
    from abhv_mc.stability.periods import find_period
    from abhv_mc.stability.points import AT_LIMIT, flown_points, near_nodes
    from abhv_mc.stability.steady import make_steady_plan, trim_points
    from abhv_mc.user_code.vehicle_functions import load_vehicle

    time: Time = "trim" if isinstance(at, str) and at == "trim" else to_si(at, TIME, "at")
    angle = to_si(bank, ANGLE, "bank")
    if angle and time != "trim":
        raise InputError("bank", "a bank", "the point 'trim', to which alone it belongs")
    if abs(angle) > _MOST_BANK:
        raise InputError("bank", f"{angle:g} rad", "-80 to 80 deg")
    law: Any = make_document("control", controller)  # read as the files that they stand for
    craft: Any = make_document("vehicle", vehicle)
    asked: Any = make_document("mission", mission)
    name, packed = law.path.stem, load_vehicle(craft)
    if packed.constants.surface_limit == 0.0 or packed.constants.equivalence_ratio_max == 0.0:
        found = "a vehicle without control surfaces or engine"
        raise InputError(craft.path, found, "one with both, to fly it with a controller")
    parameters = make_parameters(dispersions, packed)
    warnings = []
    if time == "trim":
        record, user_code = read_law(law)
        try:
            plan = make_steady_plan(packed, read_mission(asked), record, name, angle, user_code)
            plan = plan.lean_for(dispersions or ())
            taken = trim_points(plan, parameters)
        except np.linalg.LinAlgError as error:
            words = (
                f"a vehicle that its controls do not rule in steady flight ({str(error).lower()})"
            )
            expected = "surfaces with moments of their own, and a weight that they can hold"
            raise InputError(craft.path, words, expected) from None
        if taken.faults[0]:
            expected = "a start that this vehicle can be trimmed at, or a time of the flight instead of the trim"
            raise InputError(asked.path, f"a start at which {taken.faults[0]}", expected)
    else:
        plan = prepare(craft, asked, law, name).lean_for(dispersions or ())
        if not 0.0 <= time <= plan.timing.duration:
            raise InputError(
                "at", f"{time:g} s", f"a time of the mission, 0 to {plan.timing.duration:g} s"
            )
        taken = flown_points(plan, parameters, time)
        if taken.faults[0] not in ("", AT_LIMIT):
            expected = f"a time at which {name} still flies, and has slopes"
            raise InputError("at", f"{time:g} s: {taken.faults[0]}", expected)
        if taken.faults[0]:
            warnings.append(
                f"{name} at {time:g} s: {taken.faults[0]}; what is linearized knows no limits"
            )
    check_rows(plan, parameters)
    warnings += [f"{name}: {words}" for words in near_nodes(plan, taken.points)]
    warnings += [
        f"{name}: linearized with {mode}, as small changes leave it"
        for mode in find_period(plan).modes
    ]
    return Place(plan, taken.points, warnings)


def analyse_place(place: Place) -> "tuple[Linear, Stability]":
    """The linear model there, and its margins."""
    from abhv_mc.stability.analysis import analyse
    from abhv_mc.stability.linearize import linearize

    linear = linearize(place.plan, place.points)
    return linear, analyse(linear, _FREQUENCIES, apart=True)


def linearize(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> LinearModel:
    """Plant, law, open and closed loop about the trim or a time of a flight, as ``abhv-mc linearize`` writes them.

    Parameters
    ----------
    mission, vehicle, controller, dispersions
        As of :func:`abhv_mc.fly`; a user law is run.
    at
        ``trim``, the trim of the true plant at the mission's start, or a time of the flight (s, or text with a unit).
    bank
        Of the steady turn to trim for (rad, or text with a unit).

    Returns
    -------
    LinearModel
        With a law that remembers m numbers and a measurement that is d control periods old, A is [18, 18] of the plant,
        [m, m] of the law and [18 + m + 10 d, 18 + m + 10 d] of loop and closed loop.

    Raises
    ------
    InputError
        For what is wrong with an input, and where there is no such point.
    """
    import pandas as pd

    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.model_file import make_model

    place = take_point(mission, vehicle, controller, at, bank, dispersions=dispersions)
    model = make_model(place.plan, place.points, linearize(place.plan, place.points))
    point = pd.Series(model["point"]["states"], model["plant"]["states"], name="point")
    point.attrs["units"] = dict(
        zip(model["plant"]["states"], model["plant"]["state_units"], strict=True)
    )
    parts = ("plant_continuous", "plant", "law", "loop", "closed")
    return LinearModel(
        **{part: _make_tables(model[part]) for part in parts},
        period_s=model["period_s"],
        measurement_delay_periods=model["measurement_delay_periods"],
        point=point,
        warnings=tuple(place.warnings),
    )


def margins(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> "pd.DataFrame":
    """Stability margins, as ``abhv-mc margins`` prints them.

    Parameters
    ----------
    mission, vehicle, controller, at, bank, dispersions
        As of :func:`linearize`.

    Returns
    -------
    pandas.DataFrame
        A row for each loop (``aileron``, ``rudder``, ``elevator``, ``equivalence_ratio``), broken at its actuator with
        the others closed, and the row ``all`` for all inputs at once, which alone has the disk margin. A margin that
        nothing ends is infinite; all are not-a-number where the closed loop is unstable, and those of a loop that is
        not there: ``attrs["reasons"]`` says why (``stuck``, or ``no effect``). ``attrs`` hold also ``units`` of the
        columns, ``stable``, the ``poles`` of the closed loop (1/s, fastest growing first) and ``warnings``.

    Raises
    ------
    InputError
        As of :func:`linearize`.
    """
    import pandas as pd

    from abhv_mc.stability.analysis import cut_loops, margin_values

    place = take_point(mission, vehicle, controller, at, bank, dispersions=dispersions)
    _, stability = analyse_place(place)
    table = pd.DataFrame.from_dict(
        margin_values(stability), orient="index", columns=list(_MARGIN_UNITS)
    )
    table.index.name = "loop"
    table.attrs = {
        "units": dict(_MARGIN_UNITS),
        "stable": bool(stability.stable[0]),
        "poles": stability.poles[0].tolist(),
        "reasons": cut_loops(stability),
        "warnings": place.warnings,
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
) -> "pd.DataFrame":
    """Go on with a flight from what it is at a time, disturbed: the full flight that a linear model approximates.

    Parameters
    ----------
    mission, vehicle, controller, dispersions
        As of :func:`abhv_mc.fly`.
    at
        The time (s, or text with a unit).
    disturbance
        What is added to states of ``linearize(...).closed`` there, by name, SI and radians.
    duration
        How long it flies on (s, or text with a unit).

    Returns
    -------
    pandas.DataFrame
        Those states as columns (old measurements left out), in double precision, with the time as its index.

    Raises
    ------
    InputError
        As of :func:`linearize`.
    """
    import numpy as np
    import pandas as pd

    from abhv_mc.simulators.make_plans import check_rows
    from abhv_mc.stability.plant_inputs import plant_states
    from abhv_mc.stability.points import fly_disturbed
    from abhv_mc.stability.probe import law_memory_rows

    plan = make_flight_plan(mission, vehicle, controller)
    names = [*plant_states(plan.vehicle), *(f"law_{name}" for name in law_memory_rows(plan))]
    change = np.zeros(len(names))
    for name, value in (disturbance or {}).items():
        if name not in names:
            raise InputError("disturbance", f"'{name}'", one_of(names, name))
        change[names.index(name)] = value
    tick, ticks = (
        round(to_si(time, TIME, word) / plan.timing.tick)
        for time, word in ((at, "at"), (duration, "duration"))
    )
    if not 0 <= tick <= plan.timing.ticks:
        raise InputError("at", f"{at}", f"a time of the mission, 0 to {plan.timing.duration:g} s")
    parameters = make_parameters(dispersions, plan.vehicle)
    check_rows(plan, parameters)
    states = fly_disturbed(plan, parameters, tick, change, ticks)
    times = (tick + np.arange(len(states))) * plan.timing.tick
    return pd.DataFrame(states, columns=names, index=pd.Index(times, name="time"))


def _make_tables(part: dict[str, Any]) -> StateSpace:
    """Tables of a part of :func:`abhv_mc.stability.model_file.make_model`."""
    import pandas as pd

    kinds = ("state", "input", "output")
    units = {
        name: unit
        for kind in kinds
        for name, unit in zip(part[f"{kind}s"], part[f"{kind}_units"], strict=True)
        if unit
    }

    def table(name: str, rows: str, columns: str) -> "pd.DataFrame":
        made = pd.DataFrame(part[name], index=part[rows], columns=part[columns])
        made.attrs["units"] = units
        return made

    return StateSpace(
        table("A", "states", "states"),
        table("B", "states", "inputs"),
        table("C", "outputs", "states"),
        table("D", "outputs", "inputs"),
    )
