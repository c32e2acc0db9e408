"""Single flights and trims from Python: inputs by shipped name, path or mapping, results as pandas tables.

A mapping is the file's content; with ``base`` it is that file (or shipped name) with entries replaced, nested ones by
dotted keys: ``{"base": "tlc", "attitude.bank.bandwidth": "0.4 rad/s"}``. A controller may be a
law's function.
"""

import atexit
import copy
import functools
import hashlib
import math
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from abhv_mc.io.documents import Document, InputError, Refusal, describe, one_of, read_document
from abhv_mc.io.units import ANGLE, LENGTH, MASS, SPEED, Dimension, dimension_of, format_quantity, parse_quantity
from abhv_mc.shipped import find_input

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from abhv_mc.flight.plan import FlightPlan
    from abhv_mc.vehicle.model import Vehicle

Input = str | Path | Mapping[str, Any] | Callable[..., Any]
Quantity = float | str  # a number in SI (angles in rad), or text with a unit

TRIM_UNITS = {
    "bank_deg": "deg",
    "flight_path_angle_deg": "deg",
    "angle_of_attack_deg": "deg",
    "elevator_deg": "deg",
    "equivalence_ratio": "-",
    "thrust_n": "N",
    "lift_n": "N",
    "drag_n": "N",
    "lift_to_drag": "-",
    "c_tn": "-",
    "load_factor_g": "g",
    "fuel_flow_kgps": "kg/s",
    "mach": "-",
    "dynamic_pressure_pa": "Pa",
}
TRIM_LIMITS = {  # in SI
    "altitude": (LENGTH, -500.0, 86e3),
    "speed": (SPEED, 1.0, 1e4),
    "bank": (ANGLE, -1.56, 1.56),
    "flight_path_angle": (ANGLE, -1.56, 1.56),
    "latitude": (ANGLE, -1.56, 1.56),
    "heading": (ANGLE, -7.0, 7.0),
    "mass": (MASS, 1e-3, 1e7),
}


def make_document(kind: str, given: Input) -> Document:
    """An input of a kind (``vehicle``, ``mission``, ``control``) as a document. Raises InputError."""
    if callable(given):
        return _make_law_document(kind, given)
    if not isinstance(given, Mapping):
        return read_document(find_input(given, kind))
    changes = {str(key): value for key, value in given.items()}
    base = changes.pop("base", None)
    if base is None:
        return Document(Path(f"<{kind}>"), changes, {(): (1, 1)}, {})
    document = read_document(find_input(base, kind))
    data: Any = copy.deepcopy(document.data)
    for key, value in changes.items():
        *path, last = key.split(".")
        place = data
        for i, name in enumerate(path):
            if not isinstance(place, dict) or name not in place:
                known = place if isinstance(place, dict) else ()
                found = f"no entry '{'.'.join(path[: i + 1])}'"
                raise InputError(document.path, found, one_of(known, name) if known else "a mapping")
            place = place[name]
        if not isinstance(place, dict):
            raise InputError(document.path, f"no entry '{key}'", "the key of a mapping")
        place[last] = value
    return Document(document.path, data, document.value_places, document.key_places)


def _make_law_document(kind: str, law: Callable[..., Any]) -> Document:
    """A law's function as a controller; its text is taken now."""
    from abhv_mc.user_code.from_function import make_law_text

    if kind != "control":
        raise InputError(kind, "a function", "a name, a path or a mapping")
    text = make_law_text(law)
    folder = _temporary_folder() / hashlib.sha256(text.encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    file = folder / f"{law.__name__}.py"
    file.write_text(text, encoding="utf-8")
    path = file.with_suffix(".yaml")
    path.write_text(f"law: python\nfile: {file.name}\n", encoding="utf-8")
    return read_document(path)


@functools.cache
def _temporary_folder() -> Path:
    """A folder for as long as this process lives."""
    folder = tempfile.mkdtemp(prefix="abhv-mc-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


def make_flight_plan(mission: Input, vehicle: Input = "ghame_x", controller: Input = "tlc") -> "FlightPlan":
    """The plan that a controller flies: reference, gains, start. Raises InputError."""
    from abhv_mc.flight.prepare import prepare

    craft: Any = make_document("vehicle", vehicle)  # read as the files that they stand for
    asked: Any = make_document("mission", mission)
    law: Any = make_document("control", controller)
    return prepare(craft, asked, law, law.path.stem)


def make_parameters(dispersions: Mapping[str, Quantity] | None) -> "NDArray[np.float64]":
    """One row of all parameters [1, parameter], those named replaced. Raises InputError for an unknown one."""
    from abhv_mc.flight.fly import nominal_parameters
    from abhv_mc.plant.parameters import PARAMETER_INDEX, PARAMETERS

    row = nominal_parameters()
    for name, value in check_mapping({} if dispersions is None else dispersions, "dispersions").items():
        if name not in PARAMETER_INDEX or name == PARAMETERS[0].name:
            raise InputError("dispersions", f"parameter '{name}'", one_of(list(PARAMETER_INDEX)[1:], name))
        try:
            dimension = dimension_of(PARAMETERS[PARAMETER_INDEX[name]].unit)
            row[0, PARAMETER_INDEX[name]] = parse_quantity(value, dimension, dimension.unit)
        except Refusal as refusal:
            raise InputError("dispersions", f"{name}: {refusal.found}", refusal.expected) from None
    return row


def check_dispersed(plan: "FlightPlan", parameters: "NDArray[np.float64]") -> None:
    """Raise InputError for measurements later than the lanes remember, and for a limit on oscillation in moving air."""
    from abhv_mc.flight.sensors import delays_known, find_late
    from abhv_mc.plant.parameters import DISTURBANCES, PARAMETER_INDEX
    from abhv_mc.vehicle.limits import STILL_AIR

    if late := find_late(parameters, plan.timing.tick):
        raise InputError("dispersions", late, delays_known(plan.timing.tick))
    moving = [name for name in DISTURBANCES if parameters[:, PARAMETER_INDEX[name]].any()]
    if refused := plan.limits.loads.refuse_in(moving):
        raise InputError("dispersions", refused, STILL_AIR)


def check_felt(plan: "FlightPlan", parameters: "NDArray[np.float64]", names: Iterable[str]) -> None:
    """Raise InputError for a dispersion without which the flight is the same to the bit, here and farther out."""
    import numpy as np

    from abhv_mc.execution.probe_dispersions import differs
    from abhv_mc.flight.fly import fly as fly_plan
    from abhv_mc.plant.parameters import NEVER, PARAMETER_INDEX, PARAMETERS

    at = [PARAMETER_INDEX[name] for name in names]
    at = [i for i in at if parameters[0, i] != PARAMETERS[i].nominal]
    for farther in (False, True):
        rows = np.tile(parameters, (1 + len(at), 1))
        for row, i in zip(rows[1:], at, strict=True):
            nominal = PARAMETERS[i].nominal
            far = {0.0: 25.0 * row[i], NEVER: 0.5 * plan.timing.duration}.get(nominal, 1e-3 * nominal)
            row[i] = far if farther else nominal
        block = fly_plan(plan, rows)
        at = [i for k, i in enumerate(at, 1) if not differs(block, 0, k)]
        if not at:
            return
    named = ", ".join(f"'{PARAMETERS[i].name}'" for i in at)
    raise InputError("dispersions", f"{named}, without effect on this flight", "what this vehicle feels in it")


def fly(
    mission: Input,
    vehicle: Input = "ghame_x",
    controller: Input = "tlc",
    dispersions: Mapping[str, Quantity] | None = None,
    every: int = 1,
) -> "pd.DataFrame":
    """Fly one flight: a table of ``time`` (s) and every recorded channel, a row each ``every`` control ticks.

    dispersions: parameters of this flight (``abhv-mc list parameters`` lists them), the others nominal; a number is a
    factor or SI, text has its unit, as in ``{"aero.drag": "110 %", "wind.north": 12.0}``. One without effect is
    refused.
    The table's ``attrs`` hold ``units`` (of the columns), ``outcome``, ``sentence``, ``end_time_s``, ``metrics`` and
    ``metric_units`` by name, and ``warnings``. A flight that ends early has fewer rows. Raises
    :class:`abhv_mc.io.documents.InputError` for what is wrong with an input.
    """
    import pandas as pd

    from abhv_mc.flight.channels import CHANNELS
    from abhv_mc.flight.fly import fly as fly_plan
    from abhv_mc.flight.metrics import METRICS
    from abhv_mc.flight.outcome import Outcome
    from abhv_mc.simulators.end_sentence import describe_end

    steps = check_count(every, 1, "every")
    plan = make_flight_plan(mission, vehicle, controller).lean_for(dispersions or ())
    parameters = make_parameters(dispersions)
    check_dispersed(plan, parameters)
    check_felt(plan, parameters, dispersions or ())
    block = fly_plan(plan, parameters, min(steps, plan.timing.ticks + 1))
    outcome = Outcome(int(block.outcome[0]))
    table = pd.DataFrame(block.history[0].astype("float64"), columns=[channel.name for channel in CHANNELS])
    table.insert(0, "time", block.times)
    table = table[table["time"] <= block.end_time[0] + 1e-9].reset_index(drop=True)
    table.attrs = {
        "units": {"time": "s"} | {channel.name: channel.unit for channel in CHANNELS},
        "outcome": outcome.code,
        "sentence": describe_end(plan, parameters, outcome),
        "end_time_s": float(block.end_time[0]),
        "metrics": {metric.name: float(block.metrics[0, i]) for i, metric in enumerate(METRICS)},
        "metric_units": {metric.name: metric.unit for metric in METRICS},
        "warnings": plan.warnings.tolist(),
    }
    return table


def trim(
    vehicle: Input = "ghame_x",
    altitude: Quantity = "20 km",
    speed: Quantity = "1400 m/s",
    bank: Quantity | Sequence[Quantity] = 0.0,
    *,
    flight_path_angle: Quantity = 0.0,
    latitude: Quantity = "29.3 deg",
    heading: Quantity = "90 deg",
    mass: Quantity | None = None,
    rotating: bool = False,
) -> "pd.DataFrame":
    """The controls of steady flight: one row a bank angle, indexed by ``bank_deg``; ``attrs["units"]`` by column.

    A vehicle without an engine is trimmed on its glide path.

    Numbers are SI and radians, text has its unit. ``trimmed`` is False where the vehicle's limits allow no balance,
    and ``fault`` says why. The Earth is at rest unless ``rotating``. Raises InputError.
    """
    import pandas as pd

    from abhv_mc.user_code.vehicle_functions import load_vehicle

    document: Any = make_document("vehicle", vehicle)
    banks = [bank] if isinstance(bank, str | int | float | Real) else list(bank)
    if not banks:
        raise InputError("bank", "no angle", "one or more")

    given = {"altitude": altitude, "speed": speed, "flight_path_angle": flight_path_angle, "latitude": latitude}
    point = {name: trim_quantity(name, value, name) for name, value in (given | {"heading": heading}).items()}
    angles = [trim_quantity("bank", angle, "bank") for angle in banks]
    kilograms = None if mass is None else trim_quantity("mass", mass, "mass")
    rows = list(trim_rows(load_vehicle(document), point, angles, kilograms, rotating))
    table = pd.DataFrame(rows).set_index("bank_deg")
    table.attrs = {"units": dict(TRIM_UNITS)}
    return table


def trim_quantity(name: str, value: Quantity, called: str, bare_unit: str | None = None) -> float:
    """One of TRIM_LIMITS in SI; a number without a unit is SI, or in ``bare_unit``. Raises InputError."""
    dimension, low, high = TRIM_LIMITS[name]
    number = to_si(value, dimension, called, bare_unit)
    if not low <= number <= high:
        wish = f"{format_quantity(low, dimension)} to {format_quantity(high, dimension)}"
        raise InputError(called, describe(value), wish)
    return number


def trim_rows(
    vehicle: "Vehicle", point: Mapping[str, float], banks: Sequence[float], mass: float | None, rotating: bool
) -> Iterator[dict[str, Any]]:
    """The trim at each bank angle (rad) by the names of TRIM_UNITS, whether there is one, and why not.

    ``point``: the other fields of a :class:`abhv_mc.plant.trim.FlightPoint`; the Earth is at rest unless ``rotating``.
    """
    from abhv_mc.plant.trim import FlightPoint
    from abhv_mc.plant.trim import trim as balance
    from abhv_mc.world.earth import WGS84

    earth = WGS84 if rotating else WGS84._replace(rotation_rate=0.0)
    for angle in banks:
        found = balance(vehicle, earth, FlightPoint(bank=angle, **point), mass)
        yield {
            "bank_deg": math.degrees(angle),
            "flight_path_angle_deg": math.degrees(found.flight_path_angle),
            "angle_of_attack_deg": math.degrees(found.angle_of_attack),
            "elevator_deg": math.degrees(found.elevator),
            "equivalence_ratio": found.equivalence_ratio,
            "thrust_n": found.thrust,
            "lift_n": found.lift,
            "drag_n": found.drag,
            "lift_to_drag": found.lift / found.drag if found.drag else math.nan,
            "c_tn": found.c_tn,
            "load_factor_g": found.load_factor,
            "fuel_flow_kgps": found.fuel_flow,
            "mach": found.mach,
            "dynamic_pressure_pa": found.dynamic_pressure,
            "trimmed": not found.fault,
            "fault": found.fault or None,
        }


def check_count(value: int, least: int, name: str, most: int | None = None) -> int:
    """A whole number that is not below ``least`` or above ``most``. Raises InputError, which calls it ``name``."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):
        expected = f"a whole number, {least} or more" if most is None else f"a whole number from {least} to {most}"
        raise InputError(name, describe(value), expected)
    return int(value)


def check_mapping(value: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """The value itself. Raises InputError, which calls it ``name``, where it is no mapping."""
    if not isinstance(value, Mapping):
        raise InputError(name, describe(value), "a mapping")
    return value


def to_si(value: Quantity, dimension: Dimension, name: str, bare_unit: str | None = None) -> float:
    """A number in SI (or in ``bare_unit``) as it is, text by its unit. Raises InputError, which calls it ``name``."""
    try:
        return parse_quantity(value, dimension, bare_unit or dimension.unit)
    except Refusal as refusal:
        raise InputError(name, refusal.found, refusal.expected) from None
