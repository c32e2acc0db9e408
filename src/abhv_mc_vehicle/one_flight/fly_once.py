"""Simulation of a single flight: inputs, outcome and metrics.

Inputs are shipped names, paths or mappings, and dispersions. A mapping is the content of a file, or
``base`` and changed entries, as in ``{"base": "tlc", "limits.bank": "60 deg"}``.
"""

import hashlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.execution.first_flights import differs
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.documents import Document, read_document, write_document
from abhv_mc.io.messages import InputError, Refusal, check_mapping, check_names, quoted
from abhv_mc.io.units import Dimension, parse_quantity
from abhv_mc.requests import check_count
from abhv_mc.shipped import DEFAULT_VEHICLE, find_input
from abhv_mc_vehicle.flight.fly import fly as fly_plan
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.flight.vehicle_parameters import vehicle_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import NEVER, Vehicle
from abhv_mc_vehicle.user_code.from_function import make_law_text
from abhv_mc_vehicle.user_code.vehicle_functions import find_code
from abhv_mc_vehicle.vehicle_simulator.make_plans import check_rows, describe_end
from abhv_mc_vehicle.vehicle_simulator.references import temporary_folder, write_input

Input = str | Path | Mapping[str, Any] | Callable[..., Any]
Quantity = float | str  # number in SI (angles in rad), or a string with a unit


def make_document(kind: str, source: Input) -> Document:
    """Return a vehicle, mission or controller as a document.

    Raise InputError if the input is invalid.
    """
    if callable(source):
        return _make_law_document(kind, source)
    if not isinstance(source, Mapping):
        return read_document(find_input(source, kind))
    changes = {str(key): value for key, value in source.items()}
    base = changes.pop("base", None)
    if base is None:
        return Document(Path(f"<{kind}>"), changes, {(): (1, 1)}, {})
    return read_document(find_input(base, kind)).with_entries(changes)


def _make_law_document(kind: str, law: Callable[..., Any]) -> Document:
    """Return a controller document for a function, with the current source of the function."""
    if kind != "control":
        raise InputError(kind, "found a function", "a name, a path or a mapping")
    file = store_text(f"{law.__name__}.py", make_law_text(law))
    path = file.with_suffix(".yaml")
    path.write_text(f"law: python\nfile: {file.name}\n", "utf-8")
    return read_document(path)


def store_text(name: str, text: str) -> Path:
    """Write a text file to a folder of its content in the temporary folder; return its path."""
    folder = temporary_folder() / hashlib.sha256(text.encode()).hexdigest()[:16]
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text, "utf-8")
    return folder / name


def make_flight_plan(
    mission: Input, vehicle: Input = DEFAULT_VEHICLE, controller: Input = "tlc"
) -> FlightPlan:
    """Return the plan of a flight. Raise InputError if an input is invalid."""
    craft: Any = make_document("vehicle", vehicle)  # Documents are accepted in place of paths.
    mission_document: Any = make_document("mission", mission)
    law: Any = make_document("control", controller)
    return prepare(craft, mission_document, law, law.path.stem)


def make_parameters(
    dispersions: Mapping[str, Quantity] | None, vehicle: Vehicle
) -> NDArray[np.float64]:
    """Return a row [1, parameter] of nominal parameters changed by dispersions.

    Raise InputError for an unknown parameter.
    """
    table = vehicle_parameters(find_code(vehicle))
    row = table.nominal[None].copy()
    values = check_mapping({} if dispersions is None else dispersions, "dispersions")
    check_names("dispersions", values, table.dispersible, "parameter")
    for name, value in values.items():
        try:
            row[0, table.index[name]] = table[name].read(value, bare_unit=table[name].unit)
        except Refusal as refusal:
            raise InputError("dispersions", f"{name}: {refusal.found}", refusal.expected) from None
    return row


def to_si(value: Quantity, dimension: Dimension, name: str) -> float:
    """Convert a number or text with unit to SI. Raise InputError if it is invalid."""
    try:
        return parse_quantity(value, dimension, dimension.unit)
    except Refusal as refusal:
        raise InputError(name, refusal.found, refusal.expected) from None


def write_inputs(data: Mapping[str, Any], folder: Path) -> Path:
    """Write a campaign, and its inputs that are not files, to a folder.

    Return the path of the campaign.
    """

    def place(kind: str, source: Any, location: str) -> Path:
        if isinstance(source, str | Path):
            return find_input(source, kind).absolute()
        return write_input(make_document(kind, source), folder / location, kind)

    content = dict(data)
    for kind in ("vehicle", "mission"):
        if kind in content:
            content[kind] = place(kind, content[kind], kind)
    controllers = content.get("controllers")
    if isinstance(controllers, str):
        controllers = {Path(controllers).stem: controllers}
    if isinstance(controllers, Mapping):
        content["controllers"] = {
            str(name): place("control", source, f"{i}")
            for i, (name, source) in enumerate(controllers.items())
        }
    path = folder / "campaign.yaml"
    write_document(path, content)
    return path


class OneFlight(NamedTuple):
    """Single simulated flight with its plan."""

    plan: FlightPlan
    block: FlightBlock  # block with one flight
    outcome: str  # code of the outcome
    end_time: float  # end time, s
    metrics: dict[str, float]
    sentence: str  # sentence about the end of the flight


def fly_once(
    mission: Input,
    vehicle: Input,
    controller: Input,
    dispersions: Mapping[str, Quantity] | None = None,
    every: int = 1,
) -> OneFlight:
    """Simulate one flight. Raise InputError if an input is invalid.

    Channels are recorded every `every` control ticks; see :func:`abhv_mc.fly`.
    """
    plan = make_flight_plan(mission, vehicle, controller).lean_for(dispersions or ())
    parameters = make_parameters(dispersions, plan.vehicle)
    check_rows(plan, parameters)
    _check_felt(plan, parameters, dispersions or ())
    block = fly_plan(plan, parameters, min(every, plan.timing.ticks + 1))
    outcome = Outcome(int(block.outcome[0]))
    metrics = {
        metric.name: value
        for metric, value in zip(plan.metrics, block.metrics[0].tolist(), strict=True)
    }
    sentence = describe_end(plan, parameters, outcome)
    return OneFlight(plan, block, outcome.code, float(block.end_time[0]), metrics, sentence)


def fly(
    mission: Input,
    vehicle: Input = DEFAULT_VEHICLE,
    controller: Input = "tlc",
    dispersions: Mapping[str, Quantity] | None = None,
    every: int = 1,
) -> pd.DataFrame:
    """Simulate one flight.

    Parameters
    ----------
    mission, vehicle, controller
        Shipped name, path or mapping. A mapping is the content of a file, or ``base`` and changed
        entries with dotted keys, as in ``{"base": "tlc", "limits.bank": "60 deg"}``. A controller
        may also be a control-law function.
    dispersions
        Values of the parameters that are not nominal (``abhv-mc list parameters`` lists all
        parameters). A number is a factor or in SI units; a text has a unit, as in
        ``{"aero.drag": "110 %", "wind.north": 12.0}``. A parameter without effect on the flight is
        an error.
    every
        Control ticks between rows of the result.

    Returns
    -------
    pandas.DataFrame
        ``time`` (s) and all recorded channels, up to the end of the flight. ``attrs`` has ``units``
        by column, ``outcome``, ``sentence``, ``end_time_s``, ``metrics`` and ``metric_units`` by
        name, and ``warnings``.

    Raises
    ------
    InputError
        If an input is invalid.

    Examples
    --------
    >>> flight = abhv_mc.fly("level", dispersions={"aero.drag": "110 %"}, every=100)
    >>> flight.attrs["outcome"]
    'ok'
    >>> bank = flight["bank_deg"].abs().max()
    """
    flight = fly_once(mission, vehicle, controller, dispersions, check_count(every, 1, "every"))
    table = pd.DataFrame(
        flight.block.history[0].astype("float64"),
        columns=[channel.name for channel in flight.plan.channels],
    )
    table.insert(0, "time", flight.block.times)
    table = table[table["time"] <= flight.end_time + 1e-9].reset_index(drop=True)
    table.attrs = {
        "units": {"time": "s"} | {channel.name: channel.unit for channel in flight.plan.channels},
        "outcome": flight.outcome,
        "sentence": flight.sentence,
        "end_time_s": flight.end_time,
        "metrics": flight.metrics,
        "metric_units": {metric.name: metric.unit for metric in flight.plan.metrics},
        "warnings": flight.plan.warnings.tolist(),
    }
    return table


def _check_felt(plan: FlightPlan, parameters: Floats, names: Iterable[str]) -> None:
    """Raise InputError if a dispersion has no effect on the flight.

    Flights with the nominal value and with a larger value are compared bit by bit.
    """
    table = vehicle_parameters(plan.vehicle_code)
    indices = [i for i in map(table.index.get, names) if i is not None]
    indices = [i for i in indices if parameters[0, i] != table.nominal[i]]
    for farther in (False, True):
        if not indices:
            return
        rows = np.tile(parameters, (1 + len(indices), 1))
        for row, i in zip(rows[1:], indices, strict=True):
            nominal = float(table.nominal[i])
            far = {0.0: 25.0 * row[i], NEVER: 0.5 * plan.timing.duration}.get(
                nominal, 1e-3 * nominal
            )
            row[i] = far if farther else nominal
        block = fly_plan(plan, rows)
        indices = [i for k, i in enumerate(indices, 1) if not differs(block, 0, k)]
    if indices:
        named = quoted([table.records[i].name for i in indices])
        raise InputError(
            "dispersions",
            f"{named} {'has' if len(indices) == 1 else 'have'} no effect on this flight",
            "a parameter that affects this vehicle and flight",
        )
