"""What flies: how plans are made and flights computed, and the one way to fly rows of an experiment's inputs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import PROCESSES, THREADS
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.flight.plan import FlightBlock, FlightPlan, Recording
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Manifest
from abhv_mc.identity import code_hash
from abhv_mc.io.documents import InputError
from abhv_mc.simulators.corner_margins import describe_stability
from abhv_mc.simulators.margin_plans import make_margin_plans
from abhv_mc.simulators.user_simulator.process_pool import end_processes
from abhv_mc.simulators.user_simulator.user_flights import fly_user_simulator
from abhv_mc.simulators.user_simulator.user_plan import UserPlan

Recorded = Recording | int | None  # as flight.fly takes it
Fly = Callable[[FlightPlan, Floats, Recorded], FlightBlock]
Prepare = Callable[[Path, Path, Path, str], FlightPlan]


@dataclass(frozen=True)
class Engine:
    """How a plan is made and flown; tests put cheap ones in their place."""

    prepare: Prepare
    fly: Fly
    source: str  # hash of the code that flies: two of them never share a campaign
    # what margins.json holds
    find_stability: Callable[[Experiment, dict[str, FlightPlan]], dict[str, Any]] | None = None
    checked: bool = False  # whether ``source`` is what identity.code_hash() must give in every process that flies
    isolation: str = THREADS  # where "auto" flies; processes need a ``fly`` that can be imported
    close: Callable[[], None] | None = (
        None  # ends its own processes, which account for each flight that is lost
    )


def make_engine() -> Engine:
    """The compiled flight."""
    from abhv_mc.flight.prepare import prepare
    from abhv_mc.stability.fly_with_margins import fly_with_margins

    return Engine(
        prepare,
        fly_with_margins,
        code_hash(),
        describe_stability,
        checked=True,
        isolation=PROCESSES,
    )


def engine_of(experiment: Experiment, engine: Engine | None = None) -> Engine:
    """What flies an experiment: a user's simulator, or ``engine`` (by default the compiled flight)."""
    if experiment.user_model is None:
        return engine or make_engine()
    return Engine(_no_plan, fly_user_simulator, code_hash(), checked=True, close=end_processes)  # type: ignore[arg-type]


def fly_of(experiment: Experiment, fly: Fly) -> Fly:
    """What flies its flights: ``fly``, or the user's simulator."""
    return fly if experiment.user_model is None else engine_of(experiment).fly


def _no_plan(*_: object) -> FlightPlan:
    raise InputError(
        "simulator", "a user's simulator, which has no vehicle, mission and controllers", "our own"
    )


def check_source(folder: CampaignFolder, manifest: Manifest, engine: Engine) -> None:
    """Refuse to go on with other code than the one that flew so far. Raises InputError."""
    flown = manifest.source_hash
    if flown != engine.source:
        found = f"flights of another version of the program (source {flown}, now {engine.source})"
        raise InputError(folder.root, found, "the same again, another folder (-o DIR), or --fresh")


def make_ready(
    experiment: Experiment, plans: Mapping[str, FlightPlan], margins: bool = False
) -> Experiment:
    """The experiment with the controllers of ``plans`` ready to fly; with stability margins, where it asks for them.

    Raises InputError where there can be none.
    """
    found = make_margin_plans(experiment, plans) if margins else {}
    return replace(
        experiment, systems={name: System(plan, found.get(name)) for name, plan in plans.items()}
    )


def here(plan: FlightPlan, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
    """The executor that flies in this thread."""
    return (fly_user_simulator if isinstance(plan, UserPlan) else make_engine().fly)(
        plan, parameters, recorded
    )


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
