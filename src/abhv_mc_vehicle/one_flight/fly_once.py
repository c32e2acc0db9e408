"""Simulation of a single flight, with its outcome and metrics."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.input_error import InputError
from abhv_mc.io.phrases import quoted
from abhv_mc.requests import check_count
from abhv_mc.shipped import DEFAULT_VEHICLE
from abhv_mc_vehicle.one_flight.given import Input, Quantity, make_flight_plan, make_parameters

if TYPE_CHECKING:
    import pandas as pd

    from abhv_mc.array_types import Floats
    from abhv_mc.flights.blocks import FlightBlock
    from abhv_mc_vehicle.flight.plan import FlightPlan


class OneFlight(NamedTuple):
    """Single simulated flight with its plan."""

    plan: "FlightPlan"
    block: "FlightBlock"  # block with one flight
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
    from abhv_mc_vehicle.flight.fly import fly
    from abhv_mc_vehicle.vehicle_simulator.end_sentence import describe_end
    from abhv_mc_vehicle.vehicle_simulator.make_plans import check_rows

    plan = make_flight_plan(mission, vehicle, controller).lean_for(dispersions or ())
    parameters = make_parameters(dispersions, plan.vehicle)
    check_rows(plan, parameters)
    _check_felt(plan, parameters, dispersions or ())
    block = fly(plan, parameters, min(every, plan.timing.ticks + 1))
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
) -> "pd.DataFrame":
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
    import pandas as pd

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


def _check_felt(plan: "FlightPlan", parameters: "Floats", names: Iterable[str]) -> None:
    """Raise InputError if a dispersion has no effect on the flight.

    Flights with the nominal value and with a larger value are compared bit by bit.
    """
    import numpy as np

    from abhv_mc.execution.first_flights import differs
    from abhv_mc_vehicle.flight.fly import fly
    from abhv_mc_vehicle.flight.vehicle_parameters import vehicle_parameters
    from abhv_mc_vehicle.kernel.plant.parameter_names import NEVER

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
        block = fly(plan, rows)
        indices = [i for k, i in enumerate(indices, 1) if not differs(block, 0, k)]
    if indices:
        named = quoted([table.records[i].name for i in indices])
        raise InputError(
            "dispersions",
            f"{named} {'has' if len(indices) == 1 else 'have'} no effect on this flight",
            "a parameter that affects this vehicle and flight",
        )
