"""The one way to fly: rows of an experiment's inputs with one of its systems."""

from collections.abc import Mapping
from dataclasses import replace

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.simulators.engine import Fly, Recorded, make_engine
from abhv_mc.simulators.margin_plans import make_margin_plans
from abhv_mc.simulators.user_simulator.user_flights import fly_user_simulator
from abhv_mc.simulators.user_simulator.user_plan import UserPlan


def make_ready(experiment: Experiment, plans: Mapping[str, FlightPlan], margins: bool = False) -> Experiment:
    """The experiment with the controllers of ``plans`` ready to fly; with stability margins, where it asks for them.

    Raises InputError where there can be none.
    """
    found = make_margin_plans(experiment, plans) if margins else {}
    return replace(experiment, systems={name: System(plan, found.get(name)) for name, plan in plans.items()})


def here(plan: FlightPlan, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
    """The executor that flies in this thread."""
    return (fly_user_simulator if isinstance(plan, UserPlan) else make_engine().fly)(plan, parameters, recorded)


def simulate(
    experiment: Experiment,
    system: str,
    rows: Floats,
    recording: Recorded = None,
    executor: Fly = here,
    margins: bool = False,
) -> FlightBlock:
    """Fly ``rows`` [flight, input], SI, whose columns are ``experiment.inputs``; what is none of them is nominal.

    ``recording``: what is recorded, or control ticks between samples of every channel; ``margins``: the flights have
    stability margins, too, where the experiment was made ready with these.
    """
    ready = experiment.systems[system]
    plan = ready.with_margins or ready.plan if margins else ready.plan
    return executor(plan, experiment.rows(rows), recording)
