"""Simulation of flights from rows of inputs, and of the flights of a results folder again."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.experiment import Experiment, System
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.folder.hashes import read_checked
from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import Manifest, read_manifest
from abhv_mc.folder.opening import find_stored_plans
from abhv_mc.folder.samples import SampleReader
from abhv_mc.interfaces import Fly, Plan, Recorded, Simulator
from abhv_mc.io.documents import InputError, one_of


def check_source(folder: CampaignFolder, manifest: Manifest, simulator: Simulator) -> None:
    """Raise InputError if another version of the code computed the flights of a folder."""
    flown, now = manifest.source_hash, simulator.engine.source
    if flown != now:
        problem = f"another version of the program computed the flights (source {flown}, now {now})"
        raise InputError(
            folder.root, problem, "the same version, another folder (-o DIR), or --fresh"
        )


def make_ready(
    experiment: Experiment, plans: Mapping[str, Plan], margins: bool = False
) -> Experiment:
    """Return the experiment with ``plans`` as its systems.

    With ``margins``, plans that compute margins are added if the campaign requests margins. Raise
    InputError if margins cannot be computed.
    """
    mission = experiment.simulator.mission
    margin_plans = mission.add_margins(plans) if margins and mission else {}
    return replace(
        experiment,
        systems={name: System(plan, margin_plans.get(name)) for name, plan in plans.items()},
    )


def with_proofs(experiment: Experiment, check: int = 0) -> Experiment:
    """Return the experiment with the plans of :meth:`Simulator.prove`."""
    systems = {
        name: system._replace(plan=experiment.simulator.prove(system.plan, check=check))
        for name, system in experiment.systems.items()
    }
    return replace(experiment, systems=systems)


def simulate(
    experiment: Experiment,
    system: str,
    rows: Floats,
    recording: Recorded = None,
    executor: Fly | None = None,
    *,
    margins: bool = False,
) -> FlightBlock:
    """Simulate ``rows`` [flight, input] in SI units, with columns ``experiment.inputs``.

    Parameters without a column are nominal. ``recording`` is a Recording, or the number of control
    ticks between samples of all channels. ``executor`` runs the flights, by default in the calling
    thread. ``margins`` adds stability margins if the experiment has plans that compute margins.
    """
    ready = experiment.systems[system]
    plan = ready.with_margins or ready.plan if margins else ready.plan
    return (executor or experiment.simulator.engine.fly)(plan, experiment.rows(rows), recording)


def open_flown(
    folder: CampaignFolder, controllers: Iterable[str], trusted: bool = False
) -> Experiment:
    """Check a results folder and return an experiment that can re-run the folder's flights.

    Raise InputError for an unknown controller, a damaged file or untrusted code.
    """
    read_checked(folder, [folder.campaign, folder.samples, *folder.input_files()])
    experiment = read_folder_campaign(folder)
    flown = list(read_manifest(folder.manifest).controllers)
    names = list(controllers)
    for name in names:
        if name not in flown:
            raise InputError(folder.root, f"unknown controller '{name}'", one_of(flown, name))
        read_checked(folder, [folder.plan(name)])
    plans = experiment.simulator.restore_plans(find_stored_plans(folder), names, trusted)
    return replace(make_ready(experiment, plans), columns=SampleReader(folder.samples).names)
