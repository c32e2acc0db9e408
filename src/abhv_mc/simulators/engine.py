"""The one way to simulate rows of an experiment's inputs."""

from collections.abc import Mapping
from dataclasses import replace

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.flight.plan import FlightBlock
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Manifest
from abhv_mc.interfaces import Fly, Plan, Recorded, Simulator
from abhv_mc.io.documents import InputError


def check_source(folder: CampaignFolder, manifest: Manifest, simulator: Simulator) -> None:
    """Refuse to go on with other code than the one that flew so far. Raises InputError."""
    flown, now = manifest.source_hash, simulator.engine.source
    if flown != now:
        found = f"flights of another version of the program (source {flown}, now {now})"
        raise InputError(folder.root, found, "the same again, another folder (-o DIR), or --fresh")


def make_ready(
    experiment: Experiment, plans: Mapping[str, Plan], margins: bool = False
) -> Experiment:
    """The experiment with the controllers of ``plans`` ready to fly; with stability margins, where it asks for them.

    Raises InputError where there can be none.
    """
    found = experiment.simulator.add_margins(plans) if margins else {}
    return replace(
        experiment, systems={name: System(plan, found.get(name)) for name, plan in plans.items()}
    )


def simulate(
    experiment: Experiment,
    system: str,
    rows: Floats,
    recording: Recorded = None,
    executor: Fly | None = None,
    *,
    margins: bool = False,
) -> FlightBlock:
    """Fly ``rows`` [flight, input], SI, whose columns are ``experiment.inputs``; what is none of them is nominal.

    ``recording``: what is recorded, or control ticks between samples of every channel; ``executor``: what flies, by
    default this thread; ``margins``: the flights have stability margins, too, where the experiment was made ready with
    these.
    """
    ready = experiment.systems[system]
    plan = ready.with_margins or ready.plan if margins else ready.plan
    return (executor or experiment.simulator.engine.fly)(plan, experiment.rows(rows), recording)
