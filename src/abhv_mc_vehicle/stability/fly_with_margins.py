"""Simulation of flights, with stability margins as additional metrics."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.blocks import FlightBlock, Recording
from abhv_mc.flights.metrics import MARGIN_VALUES
from abhv_mc.flights.outcomes import LAW_LOST, Outcome
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.plan import FlightPlan

if TYPE_CHECKING:
    from abhv_mc_vehicle.stability.analysis import Time

AT_TRIM = -1.0  # value in MarginPlan.margin_times that denotes the trim
# number of flights linearized together; fixed, because it affects the last bits of sums
_GROUP = 32
_DIGITS = 6  # significant digits of a margin; the last bits depend on the machine's libraries


@dataclass(frozen=True, kw_only=True, eq=False)
class MarginPlan(FlightPlan):
    """Flight plan with margins: MARGIN_VALUES are appended to the metrics."""

    steady: FlightPlan  # plan of :func:`abhv_mc_vehicle.stability.steady.make_steady_plan`
    margin_times: Floats  # times at which margins are computed, s; AT_TRIM for the trim

    @property
    def metric_count(self) -> int:
        """Number of metrics of a flight, including the margins."""
        return len(self.metrics) + len(MARGIN_VALUES)


def add_margins(plan: FlightPlan, steady: FlightPlan, times: "tuple[Time, ...]") -> MarginPlan:
    """Return the plan with margins at `times`."""
    margin_times = np.array([AT_TRIM if time == "trim" else time for time in times], np.float64)
    return MarginPlan(
        **{name: getattr(plan, name) for name in plan.__dataclass_fields__},
        steady=steady,
        margin_times=margin_times,
    )


def fly_with_margins(
    plan: FlightPlan, parameters: Floats, record_every: Recording | int | None = None
) -> FlightBlock:
    """Simulate flights; add margins if `plan` is a MarginPlan, or NaN if computing them fails."""
    block = fly(plan, parameters, record_every)
    if not isinstance(plan, MarginPlan):
        return block
    groups = [
        _find_any(plan, parameters[first : first + _GROUP])
        for first in range(0, len(parameters), _GROUP)
    ]
    values = np.concatenate(groups) if groups else np.empty((0, len(MARGIN_VALUES)))
    values[np.isin(block.outcome, (Outcome.FAILED_TO_RUN, *LAW_LOST))] = np.nan
    return replace(block, metrics=np.hstack([block.metrics, values]))


def _find_any(plan: MarginPlan, parameters: Floats) -> Floats:
    """Return the margins of a group of flights, computed one by one if the group fails."""
    try:
        return _find(plan, parameters)
    except Exception:
        if len(parameters) == 1:
            return np.full((1, len(MARGIN_VALUES)), np.nan)
        return np.vstack([_find_any(plan, row[None]) for row in parameters])


def _find(plan: MarginPlan, parameters: Floats) -> Floats:
    """Return the margins [flight, value] of a group, which is padded with its last flight."""
    from abhv_mc_vehicle.stability.analysis import margins_of_flights

    count = len(parameters)
    rows = np.vstack([parameters, np.tile(parameters[-1], (_GROUP - count, 1))])
    times: list[Time] = ["trim" if time == AT_TRIM else time for time in plan.margin_times.tolist()]
    margins = margins_of_flights(plan, plan.steady, rows, times)
    faults = np.array(margins.faults)  # faults [time, flight]
    columns = [
        margins.table,
        *((np.char.find(faults, word) >= 0).sum(axis=0) for word in ("unstable", "limit")),
    ]
    return np.array(
        [
            [float(f"{value:.{_DIGITS}g}") for value in row]
            for row in np.column_stack(columns)[:count]
        ]
    )
