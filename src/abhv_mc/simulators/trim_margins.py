"""Stability margins of any vehicle of a campaign in steady flight at the mission's start: nothing flies."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import MarginsOfFlights
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.simulators.engine import make_engine
from abhv_mc.simulators.make_plans import make_plans
from abhv_mc.simulators.margin_plans import make_margin_plans
from abhv_mc.stability.fly_with_margins import MarginPlan

Margins = tuple[Floats, list[str]]  # [flight, margin] in the order of MARGIN_NAMES, and why a flight has none
TrimMargins = Callable[[Floats], Margins]  # of rows [flight, parameter]


def trim_margins(campaign: Experiment, controllers: Iterable[str]) -> dict[str, TrimMargins]:
    """For each controller what finds the margins of rows [flight, parameter]. Raises InputError where none can be."""
    model = campaign.model.model_copy(update={"margins": MarginsOfFlights()})
    plans = make_plans(campaign, controllers, make_engine())
    made = make_margin_plans(replace(campaign, model=model), plans)
    return {name: partial(_margins_of, plan) for name, plan in made.items()}


def _margins_of(plan: MarginPlan, rows: Floats) -> Margins:
    from abhv_mc.stability.analysis import margins_of_flights

    found = margins_of_flights(plan, plan.steady, rows, ("trim",))
    return found.table, found.faults[0]
