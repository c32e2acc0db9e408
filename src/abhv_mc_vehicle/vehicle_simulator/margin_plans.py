"""Plans that compute stability margins of flights, and margins of dispersed trims."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.interfaces import TrimMargins
from abhv_mc.io.input_error import InputError
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.stability.fly_with_margins import MarginPlan, add_margins

if TYPE_CHECKING:  # Workers do not import these modules.
    from abhv_mc.campaign.file.experiment import Experiment

Margins = tuple[
    Floats, list[str]
]  # margins [flight, margin] in the order of MARGIN_NAMES, and reasons for missing ones
_LOOKED_AT = 1000  # number of flights whose sensor intervals are checked


def make_margin_plans(
    campaign: "Experiment", plans: Mapping[str, FlightPlan]
) -> dict[str, MarginPlan]:
    """Return plans that compute stability margins; empty if no margins are requested.

    Raise InputError if margins cannot be computed.
    """
    model = campaign.model
    if model.margins is None:
        return {}

    from abhv_mc_vehicle.stability.periods import find_period
    from abhv_mc_vehicle.stability.sensor_states import repeats_after, sensor_ticks

    vehicle = next(iter(plans.values())).vehicle
    if vehicle.constants.surface_limit == 0.0 or vehicle.constants.equivalence_ratio_max == 0.0:
        problem = "stability margins require control surfaces and an engine"
        raise InputError(model.vehicle, problem, "a vehicle with both")
    sampled = campaign.rows(campaign.make_samples().draw(0, min(campaign.runs, _LOOKED_AT)))
    margin_plans: dict[str, MarginPlan] = {}
    for name, plan in plans.items():
        steady = make_steady(campaign, plan, model.controllers[name])
        period = find_period(
            steady
        ).ticks  # Control laws without a period are rejected before any simulation.
        for ticks in np.unique(sensor_ticks(steady, sampled), axis=0):
            repeats_after(ticks, period)
        margin_plans[name] = add_margins(plan, steady, model.margins.at)
    return margin_plans


def make_steady(campaign: "Experiment", plan: FlightPlan, controller: Path) -> FlightPlan:
    """Return the plan of steady flight at the start of the mission.

    Raise InputError if there is no trim.
    """
    from abhv_mc_vehicle.control.controller_file import read_controller
    from abhv_mc_vehicle.control.mission import read_mission
    from abhv_mc_vehicle.flight.prepare import user_law_of
    from abhv_mc_vehicle.stability.steady import make_steady_plan

    law, mission = read_controller(controller), read_mission(campaign.model.mission)
    steady = make_steady_plan(
        plan.vehicle, mission, law, plan.controller, user_code=user_law_of(plan, law)
    )
    return steady.lean_for(campaign.varied)


def trim_margins(campaign: "Experiment", controllers: Sequence[str]) -> dict[str, TrimMargins]:
    """Return, for each controller, a function that computes margins of dispersed trims.

    Its argument is an array of rows [flight, parameter]; no flight is simulated. Raise InputError
    if margins cannot be computed.
    """
    from abhv_mc_vehicle.vehicle_simulator.campaign_file import MarginsOfFlights

    model = campaign.model.model_copy(update={"margins": MarginsOfFlights()})
    changed = replace(campaign, model=model)
    margin_plans = make_margin_plans(changed, changed.simulator.make_plans(controllers))
    return {name: partial(_margins_of, plan) for name, plan in margin_plans.items()}


def _margins_of(plan: Any, rows: Floats) -> Margins:
    from abhv_mc_vehicle.stability.analysis import margins_of_flights

    flight_margins = margins_of_flights(plan, plan.steady, rows, ("trim",))
    return flight_margins.table, flight_margins.faults[0]
