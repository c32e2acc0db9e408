"""Stability margins that a campaign asks for: plans of its flights with them, and those of any vehicle at the start."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.metrics import MARGIN_VALUES
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.io.input_error import InputError
from abhv_mc.stability.fly_with_margins import MarginPlan, add_margins

if TYPE_CHECKING:  # which a worker process need not import
    from abhv_mc.campaign.file.experiment import Experiment

Margins = tuple[
    Floats, list[str]
]  # [flight, margin] in the order of MARGIN_NAMES, and why a flight has none
TrimMargins = Callable[[Floats], Margins]  # of rows [flight, parameter]
_LOOKED_AT = 1000  # flights whose sensors are to repeat with the law


def make_margin_plans(
    campaign: "Experiment", plans: Mapping[str, FlightPlan]
) -> dict[str, MarginPlan]:
    """The plans with margins; none where the campaign asks for none. Raises InputError where there can be none."""
    model = campaign.model
    if model.margins is None:
        return {}

    from abhv_mc.stability.periods import find_period
    from abhv_mc.stability.sensor_states import repeats_after, sensor_ticks

    vehicle = next(iter(plans.values())).vehicle
    if vehicle.constants.surface_limit == 0.0 or vehicle.constants.equivalence_ratio_max == 0.0:
        found = "margins of a vehicle without control surfaces or engine"
        raise InputError(model.vehicle, found, "one with both")
    sampled = campaign.rows(campaign.make_samples().draw(0, min(campaign.runs, _LOOKED_AT)))
    made: dict[str, MarginPlan] = {}
    for name, plan in plans.items():
        steady = make_steady(campaign, plan, model.controllers[name])
        period = find_period(steady).ticks  # a law that has none is refused before anything flies
        for ticks in np.unique(sensor_ticks(steady, sampled), axis=0):
            repeats_after(ticks, period)
        made[name] = add_margins(plan, steady, model.margins.at)
    return made


def make_steady(campaign: "Experiment", plan: FlightPlan, controller: Path) -> FlightPlan:
    """The plan of a controller's steady flight at the mission's start. Raises InputError where there is none."""
    from abhv_mc.control.controller_file import read_controller
    from abhv_mc.control.mission import read_mission
    from abhv_mc.flight.prepare import user_parts_of
    from abhv_mc.stability.steady import make_steady_plan

    law, mission = read_controller(controller), read_mission(campaign.model.mission)
    steady = make_steady_plan(
        plan.vehicle, mission, law, plan.controller, user_code=user_parts_of(plan, law)
    )
    return steady.lean_for(campaign.varied)


def count_metrics(plan: FlightPlan) -> int:
    """Columns of the metrics of this plan's flights."""
    return len(plan.metrics) + (len(MARGIN_VALUES) if isinstance(plan, MarginPlan) else 0)


def trim_margins(campaign: "Experiment", controllers: Sequence[str]) -> dict[str, TrimMargins]:
    """For each controller what finds the margins of rows [flight, parameter] in steady flight; nothing flies.

    Raises InputError where there can be none.
    """
    from abhv_mc.campaign.file.config import MarginsOfFlights

    model = campaign.model.model_copy(update={"margins": MarginsOfFlights()})
    simulator = replace(campaign, model=model).simulator
    made = simulator.add_margins(simulator.make_plans(controllers))
    return {name: partial(_margins_of, plan) for name, plan in made.items()}


def _margins_of(plan: Any, rows: Floats) -> Margins:
    from abhv_mc.stability.analysis import margins_of_flights

    found = margins_of_flights(plan, plan.steady, rows, ("trim",))
    return found.table, found.faults[0]
