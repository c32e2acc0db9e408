"""Linear models and stability margins of one flight from Python: inputs as in :mod:`abhv_mc.flying`."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from abhv_mc.flying import Input, Quantity, check_dispersed, make_document, make_parameters, to_si
from abhv_mc.io.documents import Document, InputError
from abhv_mc.io.units import ANGLE, TIME

if TYPE_CHECKING:
    import pandas as pd

    from abhv_mc.array_types import Floats
    from abhv_mc.control.controller_file import Controller
    from abhv_mc.control.mission import Mission
    from abhv_mc.flight.plan import FlightPlan
    from abhv_mc.flight.prepare import UserParts
    from abhv_mc.stability.analysis import Time
    from abhv_mc.stability.linearize import Points
    from abhv_mc.vehicle.model import Vehicle

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


class Setup(NamedTuple):
    """One controller with what it flies."""

    files: tuple[Any, Any, Any]  # vehicle, mission, controller: paths, or documents that stand for them
    vehicle: "Vehicle"
    mission: "Mission"
    controller: "Controller"
    user_code: "UserParts | None"  # of a law of the user's own


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

    plant_continuous: StateSpace  # path coordinates and actuators; from commands to the path coordinates
    plant: StateSpace  # the same under held commands
    law: StateSpace  # its memory; from the measurement to the commands
    loop: StateSpace  # all loops cut at the actuators: from what goes in there to minus what the law commands
    closed: StateSpace  # from disturbances of the commands to path coordinates and commands
    period_s: float  # of the control
    measurement_delay_periods: int
    point: "pd.Series"  # states at the point; ``attrs["units"]``
    warnings: tuple[str, ...]  # such as that a table's node is near


def read_setup(files: tuple[Path | Document, Path | Document, Path | Document]) -> Setup:
    """Vehicle, mission and controller; the code of a law of the user's own is run. Raises InputError."""
    from abhv_mc.control.mission import read_mission
    from abhv_mc.flight.prepare import read_law
    from abhv_mc.user_code.vehicle_functions import load_vehicle

    some: tuple[Any, Any, Any] = files
    vehicle = load_vehicle(some[0])
    if vehicle.constants.surface_limit == 0.0 or vehicle.constants.equivalence_ratio_max == 0.0:
        found = "a vehicle without control surfaces or engine"
        raise InputError(_path(some[0]), found, "one with both, to fly it with a controller")
    return Setup(files, vehicle, read_mission(some[1]), *read_law(some[2]))


def find_point(setup: Setup, name: str, time: "Time", bank: float, parameters: "Floats", asked: str = "at") -> Place:
    """The point of one flight, ``parameters`` [1, parameter], at a time (s) or the trim with a bank (rad).

    Raises InputError where there is none; it calls the time ``asked``.
    """
    import numpy as np

    from abhv_mc.flight.prepare import prepare
    from abhv_mc.stability.nodes import near_nodes
    from abhv_mc.stability.points import flown_points
    from abhv_mc.stability.steady import make_steady_plan, trim_points

    warnings = []
    if time == "trim":
        try:
            plan = make_steady_plan(setup.vehicle, setup.mission, setup.controller, name, bank, setup.user_code)
            found = trim_points(plan, parameters)
        except np.linalg.LinAlgError as error:
            words = f"a vehicle that its controls do not rule in steady flight ({str(error).lower()})"
            expected = "surfaces with moments of their own, and a weight that they can hold"
            raise InputError(_path(setup.files[0]), words, expected) from None
        if found.faults[0]:
            expected = "a start that this vehicle can be trimmed at, or a time of the flight instead of the trim"
            raise InputError(_path(setup.files[1]), f"a start at which {found.faults[0]}", expected)
    else:
        if not 0.0 <= time <= setup.mission.duration:
            expected = f"a time of the mission, 0 to {setup.mission.duration:g} s"
            raise InputError(asked, f"{time:g} s", expected)
        plan = prepare(*setup.files, name)
        found = flown_points(plan, parameters, time)
        if found.faults[0].startswith("the flight"):
            expected = f"a time at which {name} still flies"
            raise InputError(asked, f"{time:g} s: {found.faults[0]}", expected)
        if found.faults[0]:
            warnings.append(f"{name} at {time:g} s: {found.faults[0]}; what is linearized knows no limits")
    warnings += [f"{name}: {words}" for words in near_nodes(plan, found.points)]
    return Place(plan, found.points, warnings)


def check_bank(bank: float, straight: bool, name: str = "bank") -> float:
    """A bank (rad) of a steady turn. Raises InputError for one that no trim can have, or that no trim asks for."""
    if bank and straight:
        raise InputError(name, "a bank", "the point 'trim', to which alone it belongs")
    if abs(bank) > _MOST_BANK:
        raise InputError(name, f"{bank:g} rad", "-80 to 80 deg")
    return bank


def linearize(
    mission: Input,
    vehicle: Input = "ghame_x",
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> LinearModel:
    """Plant, law, open and closed loop about the trim or a time of a flight, as ``abhv-mc linearize`` writes them.

    mission, vehicle, controller, dispersions: as in :func:`abhv_mc.fly`; a user law is run. at: ``trim``, the
    trim of the true plant at the mission's start, or a time of the flight (s, or text with a unit). bank: of the steady
    turn to trim for (rad, or text with a unit). With a law that remembers m numbers and a measurement that is d control
    periods old, A is [18, 18] of the plant, [m, m] of the law and [18 + m + 10 d, 18 + m + 10 d] of loop and closed
    loop. Raises :class:`abhv_mc.io.documents.InputError` for what is wrong with an input, and where there is no such
    point.
    """
    import pandas as pd

    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.model_file import make_model

    place, _ = _place(mission, vehicle, controller, at, bank, dispersions)
    model = make_model(place.plan, place.points, linearize(place.plan, place.points))
    point = pd.Series(model["point"]["states"], model["plant"]["states"], name="point")
    point.attrs["units"] = dict(zip(model["plant"]["states"], model["plant"]["state_units"], strict=True))
    return LinearModel(
        plant_continuous=_make_tables(model["plant_continuous"]),
        plant=_make_tables(model["plant"]),
        law=_make_tables(model["law"]),
        loop=_make_tables(model["loop"]),
        closed=_make_tables(model["closed"]),
        period_s=model["period_s"],
        measurement_delay_periods=model["measurement_delay_periods"],
        point=point,
        warnings=tuple(place.warnings),
    )


def margins(
    mission: Input,
    vehicle: Input = "ghame_x",
    controller: Input = "tlc",
    at: Quantity = "trim",
    *,
    bank: Quantity = 0.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> "pd.DataFrame":
    """Stability margins, as ``abhv-mc margins`` prints them: arguments and errors are those of :func:`linearize`.

    A row for each loop (``aileron``, ``rudder``, ``elevator``, ``equivalence_ratio``), broken at its actuator with the
    others closed, and the row ``all`` for all inputs at once, which alone has the disk margin. A margin that nothing
    ends is infinite; all are not-a-number where the closed loop is unstable, and those of a loop that is not there:
    ``attrs["reasons"]`` says why (``stuck``, or ``no effect``). ``attrs`` hold also ``units`` of the columns,
    ``stable``, the ``poles`` of the closed loop (1/s, fastest growing first) and ``warnings``.
    """
    import pandas as pd

    from abhv_mc.stability.analysis import analyse
    from abhv_mc.stability.linearize import linearize
    from abhv_mc.stability.rows import cut_loops, margin_values

    place, _ = _place(mission, vehicle, controller, at, bank, dispersions)
    stability = analyse(linearize(place.plan, place.points), _FREQUENCIES)
    table = pd.DataFrame.from_dict(margin_values(stability), orient="index", columns=list(_MARGIN_UNITS))
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
    vehicle: Input = "ghame_x",
    controller: Input = "tlc",
    at: Quantity = 0.0,
    *,
    disturbance: Mapping[str, float] | None = None,
    duration: Quantity = 1.0,
    dispersions: Mapping[str, Quantity] | None = None,
) -> "pd.DataFrame":
    """Go on with a flight from what it is at a time, disturbed: the full flight that a linear model approximates.

    at: the time (s, or text with a unit). disturbance: what is added to states of ``linearize(...).closed`` there, by
    name, SI and radians. The table has the time as its index and those states as columns (old measurements left out),
    in double precision. Other arguments and errors as of :func:`linearize`.
    """
    import numpy as np
    import pandas as pd

    from abhv_mc.flying import make_flight_plan
    from abhv_mc.io.documents import one_of
    from abhv_mc.stability.disturbed import fly_disturbed
    from abhv_mc.stability.linearize import PLANT_STATES
    from abhv_mc.stability.probe import law_memory_rows

    plan = make_flight_plan(mission, vehicle, controller)
    names = [*PLANT_STATES, *(f"law_{name}" for name in law_memory_rows(plan))]
    change = np.zeros(len(names))
    for name, value in (disturbance or {}).items():
        if name not in names:
            raise InputError("disturbance", f"'{name}'", one_of(names, name))
        change[names.index(name)] = value
    tick, ticks = (
        round(to_si(time, TIME, word) / plan.timing.tick) for time, word in ((at, "at"), (duration, "duration"))
    )
    if not 0 <= tick <= plan.timing.ticks:
        raise InputError("at", f"{at}", f"a time of the mission, 0 to {plan.timing.duration:g} s")
    parameters = make_parameters(dispersions)
    check_dispersed(plan, parameters)
    states = fly_disturbed(plan, parameters, tick, change, ticks)
    times = (tick + np.arange(len(states))) * plan.timing.tick
    return pd.DataFrame(states, columns=names, index=pd.Index(times, name="time"))


def _place(
    mission: Input,
    vehicle: Input,
    controller: Input,
    at: Quantity,
    bank: Quantity,
    dispersions: Mapping[str, Quantity] | None,
) -> "tuple[Place, Floats]":
    time: Time = "trim" if isinstance(at, str) and at == "trim" else to_si(at, TIME, "at")
    angle = check_bank(to_si(bank, ANGLE, "bank"), time != "trim")
    law = make_document("control", controller)
    setup = read_setup((make_document("vehicle", vehicle), make_document("mission", mission), law))
    parameters = make_parameters(dispersions)
    place = find_point(setup, law.path.stem, time, angle, parameters)
    check_dispersed(place.plan, parameters)
    return place, parameters


def _path(file: Path | Document) -> Path:
    return file.path if isinstance(file, Document) else file


def _make_tables(part: dict[str, Any]) -> StateSpace:
    """Tables of a part of :func:`abhv_mc.stability.model_file.make_model`."""
    import pandas as pd

    kinds = ("state", "input", "output")
    units = {
        name: unit for kind in kinds for name, unit in zip(part[f"{kind}s"], part[f"{kind}_units"], strict=True) if unit
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
