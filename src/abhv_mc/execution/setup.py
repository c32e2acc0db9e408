"""Setup of a run: checks of the request, and creation or opening of the results folder."""

import re
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from abhv_mc.campaign.file.check import check_campaign, read_campaign
from abhv_mc.campaign.file.config import PROCESSES
from abhv_mc.campaign.file.experiment import Experiment, check_user_code
from abhv_mc.campaign.file.feasibility import asked_in_vain
from abhv_mc.campaign.file.requirement_set import JUDGING, find_requirement_changes
from abhv_mc.campaign.sampling.designs import EXTENSIBLE
from abhv_mc.custom_code.child import called_beside
from abhv_mc.custom_code.source import find_package_versions, trust
from abhv_mc.execution.executor import check_source, find_isolation, make_ready
from abhv_mc.execution.first_flights import FirstFlights, fly_first
from abhv_mc.execution.unknown_points import select_points, with_points
from abhv_mc.flights.repeatability import Repeatability
from abhv_mc.folder.flights import SampleReader, write_samples
from abhv_mc.folder.hashes import KEY, FileHashes, Products, read_checked
from abhv_mc.folder.histories import write_nominal, write_reference
from abhv_mc.folder.inputs import (
    FolderInputs,
    collect_inputs,
    describe_changes,
    merge_inputs,
    read_folder_campaign,
    read_folder_inputs,
)
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import RUNNING, Manifest
from abhv_mc.folder.opening import (
    FlownFolder,
    begin_folder,
    find_stored_plans,
    grow_folder,
    open_folder,
)
from abhv_mc.folder.requirement_sets import (
    add_requirement_set,
    count_known_flights,
    mark_later_choices,
)
from abhv_mc.identity import find_commit, find_machine, find_versions
from abhv_mc.interfaces import Engine, Plan
from abhv_mc.io.input_files import reading_once
from abhv_mc.io.messages import InputError, counted, notify, quoted
from abhv_mc.requests import Request


@dataclass(frozen=True)
class OpenCampaign:
    """Campaign with plans and a locked folder, ready to run."""

    folder: CampaignFolder
    campaign: Experiment  # campaign stored in the folder, with its flight plans
    manifest: Manifest
    requested: tuple[str, ...]  # names of the controllers to run
    files: FileHashes

    @property
    def plans(self) -> dict[str, Plan]:
        """Flight plans by controller."""
        return {name: system.plan for name, system in self.campaign.systems.items()}

    @property
    def shard(self) -> tuple[int, int]:
        """Range (first, stop) of the flights in the folder."""
        i, n = self.manifest.shard or (1, 1)
        return self.campaign.runs * (i - 1) // n, self.campaign.runs * i // n


_REPEATABLE = (None, Repeatability.EXACT, Repeatability.ROUNDING)
# changes that leave the values of flights as they are
_ADDED = re.compile(
    r"metrics\..*: nothing -> |(keep|histories|channels)\b|inputs/(channels|simulator)/"
)


class AddedValuesError(InputError):
    """Error raised if a folder lacks only metrics or histories, and its flights can be repeated."""

    identity = ""  # hash of the requested inputs


def open_campaign(request: Request, engine: Engine | None, stack: ExitStack) -> OpenCampaign:
    """Check the request, then create or open and lock the results folder.

    ``stack`` releases the lock. Raise InputError, before files are created, if the request or the
    folder is invalid.
    """
    stack.enter_context(reading_once())
    requested = read_campaign(
        request.campaign, request.runs, request.seed, request.controllers, engine
    )
    simulator = requested.simulator
    folder = CampaignFolder(Path(request.output or Path("reports") / requested.model.name))
    for source in check_user_code(requested, request.trust_code):
        trust(source)  # The user explicitly runs the campaign with this code.
    _check_shard(request, requested)
    inputs = collect_inputs(requested)
    flown = open_folder(folder, request.fresh, stack)
    if flown is not None:
        if requested.unknowns.names:
            stored = read_folder_inputs(flown.folder, flown.manifest)
            requested = with_points(requested, stored.data.get("points"))
            inputs = collect_inputs(requested)
        return _resume(flown, requested, inputs, request)
    _start_workers(request, requested)
    plans_folder = Path(request.plans) if request.plans else None
    plans = _read_plans(plans_folder, requested, inputs, request.trust_code)
    plans = plans or simulator.make_plans(requested.controllers)
    engine = simulator.engine
    if request.shard is None and engine.find_stability and not engine.is_stability_compiled():
        # Another process compiles the code for margins, unless it is cached.
        stack.enter_context(called_beside(engine.find_stability, requested, plans))
    first = _fly_first(requested, plans, request.workers)
    if requested.unknowns.names:
        baseline = None
        if request.baseline is not None:
            baseline = read_folder_campaign(CampaignFolder(Path(request.baseline))).unknowns
        requested = select_points(requested, plans, request.workers, baseline)
        inputs = collect_inputs(requested)
    requested = replace(requested, repeatability=first.repeatability)
    ready = make_ready(requested, plans, margins=True)
    files = begin_folder(folder, inputs, plans, stack)
    _write_samples(folder, requested)
    _write_nominal(folder, requested, plans, first)
    manifest = files.write_manifest(
        make_manifest(requested, inputs, plans, first.warnings), shard=request.shard
    )
    return OpenCampaign(folder, ready, manifest, tuple(plans), files)


def _read_plans(
    root: Path | None, campaign: Experiment, inputs: FolderInputs, trust_code: bool
) -> Mapping[str, Plan]:
    """Read the plans stored in the folder ``root``, unless ``root`` is None.

    Raise InputError if the plans were made from other inputs.
    """
    if root is None:
        return {}
    campaign.simulator.check("--plans")
    source, names = CampaignFolder(root), campaign.controllers
    manifest = read_checked(source, [source.plan(name) for name in names])
    check_source(source, manifest, campaign.simulator)
    for path, content in inputs.hashes.items():
        if manifest.inputs.get(path) != content and not path.startswith("inputs/samples/"):
            problem = f"the plans were made from a different {path}"
            raise InputError(root, problem, "plans that were made from the files of this campaign")
    return campaign.simulator.restore_plans(find_stored_plans(source), names, trust_code)


def _start_workers(request: Request, campaign: Experiment) -> None:
    """Start worker processes, which import modules while the campaign is prepared."""
    engine = campaign.simulator.engine
    if request.scheduler is None and find_isolation(engine, campaign.model.execution) == PROCESSES:
        from abhv_mc.execution.worker_processes import start_fork_server  # loads flight code

        start_fork_server(engine.fly)


def _check_shard(request: Request, campaign: Experiment) -> None:
    """Raise InputError if the requested shard is impossible in the campaign."""
    if request.shard is None:
        return
    i, n = request.shard
    if not 1 <= i <= n <= campaign.runs:
        problem = f"a campaign of {counted(campaign.runs, 'flight')} has no shard {i}/{n}"
        raise InputError("--shard", problem, f"a shard i/n with 1 <= i <= n <= {campaign.runs}")
    if campaign.model.stop:
        problem = "a campaign with 'stop' cannot be divided into shards"
        expected = "no key 'stop', because a shard does not know the flights of other shards"
        raise InputError("--shard", problem, expected)


def _resume(
    flown: FlownFolder,
    requested: Experiment,
    inputs: FolderInputs,
    request: Request,
) -> OpenCampaign:
    """Resume a folder of the same campaign, possibly with more flights or controllers."""
    folder, files = flown.folder, flown.files
    manifest = replace(flown.manifest, file_runs=_planned_runs(requested))
    simulator = requested.simulator
    before = read_folder_inputs(folder, manifest)
    _check_same(flown, before, requested, inputs, request)
    added = [name for name in requested.controllers if name not in before.systems]
    if added and requested.unknowns.names:
        problem = f"the values of the unknowns in this folder were selected without {quoted(added)}"
        raise InputError(folder.root, problem, "another folder (-o DIR), or --fresh")
    longer = requested.runs_at_point > before.data["runs"]
    merged = merge_inputs(before, inputs, request.controllers is not None)
    limits = [*map(str, find_requirement_changes(before.data, merged.data))]
    is_rejudged = any(merged.data.get(key) != before.data.get(key) for key in JUDGING)
    # If a run was killed while it extended the folder, the manifest lacks the campaign file.
    changed = added or longer or is_rejudged or not files.knows(folder.campaign)
    products = Products(folder, merged.systems, requested.runs)
    nominal = products.nominal, products.reference
    is_current = all(product.is_current(files) for product in nominal)
    has_nominal = is_current or simulator.mission is None
    if added or longer or not has_nominal or not manifest.complete:
        check_source(folder, manifest, simulator)
        _start_workers(request, requested)
    new = simulator.make_plans(added)
    if new and simulator.capabilities.is_repeatable:
        # Reject invalid plans before files are changed.
        _fly_first(requested, new, request.workers)
    draw = requested.make_samples().draw
    if longer and files.knows(folder.samples) and not SampleReader(folder.samples).agrees(draw):
        problem = "this version of the program draws different samples"
        expected = "the library versions listed in the manifest, or --fresh"
        raise InputError(folder.samples, problem, expected)
    if limits:
        manifest = add_requirement_set(folder, manifest, before.data, merged.data)
        notify(
            f"requirements changed after {counted(count_known_flights(manifest), 'flight')}: "
            f"{'; '.join(limits)}; stored flights are judged, not run again"
        )
    if changed:
        grown = replace(flown, manifest=manifest)
        manifest = grow_folder(grown, inputs, merged, plans=new, products=products, longer=longer)
    campaign = _join(requested, inputs, merged if changed else before)
    campaign, _ = mark_later_choices(folder, manifest, campaign)
    if not files.knows(folder.samples):
        _write_samples(folder, campaign)
    stored = [name for name in campaign.controllers if name not in new]
    restored = simulator.restore_plans(find_stored_plans(folder), stored, request.trust_code)
    all_plans = {**new, **restored}
    plans = {name: all_plans[name] for name in campaign.controllers}
    if changed:
        first = () if simulator.capabilities.is_repeatable else manifest.warnings
        warnings = dict.fromkeys([*first, *_find_warnings(campaign, plans)])
        manifest = replace(manifest, warnings=tuple(warnings))
    if not has_nominal:
        first_flights = _fly_first(campaign, plans, request.workers)
        _write_nominal(folder, campaign, plans, first_flights)
    if manifest.files != files.listed():
        manifest = files.write_manifest(manifest)
    ready = make_ready(campaign, plans, margins=True)
    ready = replace(ready, repeatability=manifest.repeatable)
    return OpenCampaign(folder, ready, manifest, requested.controllers, files)


def _join(requested: Experiment, inputs: FolderInputs, merged: FolderInputs) -> Experiment:
    """Return the requested campaign with the controllers of earlier runs in the folder."""
    if (merged.data, list(merged.systems)) == (inputs.data, list(inputs.systems)):
        return requested
    campaign = check_campaign(merged.document, requested.engine)
    return replace(
        campaign, model=campaign.model.model_copy(update={"execution": requested.model.execution})
    )


def _check_same(
    flown: FlownFolder,
    before: FolderInputs,
    requested: Experiment,
    inputs: FolderInputs,
    request: Request,
) -> None:
    """Raise InputError unless the requested campaign equals or extends the stored campaign."""
    root, shard = flown.folder.root, flown.manifest.shard
    if flown.manifest.search:
        raise InputError(
            root, "the folder contains the flights of a search", "another folder (-o DIR)"
        )
    if shard != request.shard:
        content = "the whole campaign" if shard is None else f"shard {shard[0]}/{shard[1]}"
        raise InputError(
            root,
            f"the folder contains {content}",
            "the same option --shard, or another folder (-o DIR)",
        )
    changes = describe_changes(before, inputs, requested.sampling in EXTENSIBLE)
    if changes:
        more = f" and {len(changes) - 3} more" if len(changes) > 3 else ""
        problem = f"the folder was computed with other inputs ({'; '.join(changes[:3])}{more})"
        same = "the same campaign"
        if flown.manifest.source_hash != requested.simulator.engine.source:
            problem += " and with another version of the program"
            same += " and version"
        expected = f"{same}, another folder (-o DIR), or --fresh to delete the flights"
        repeats = requested.can_rerun and flown.manifest.repeatable in _REPEATABLE
        is_whole = flown.manifest.complete and set(before.systems) <= set(requested.controllers)
        adds = all(map(_ADDED.match, changes)) and not changes[0].startswith("inputs/")
        if repeats and is_whole and adds:
            error = AddedValuesError(root, problem, expected)
            error.identity = inputs.identity
            raise error
        raise InputError(root, problem, expected)
    if shard and requested.runs_at_point > before.data["runs"]:
        raise InputError(
            root,
            "the folder contains a shard of fewer flights",
            "another folder (-o DIR), because shards cannot be extended",
        )


def _fly_first(
    campaign: Experiment, plans: Mapping[str, Plan], workers: int | None
) -> FirstFlights:
    """Run the first flights. Raise InputError if a sampling rate is invalid."""
    find = campaign.simulator.find_stride
    every = {name: find(plan, "histories") for name, plan in plans.items()}
    for plan in plans.values():
        find(plan, "envelopes")
    return fly_first(make_ready(campaign, plans), workers, every)


def _find_warnings(campaign: Experiment, plans: Mapping[str, Plan]) -> list[str]:
    own = campaign.simulator.find_warnings(plans)
    return list(dict.fromkeys([*own, *asked_in_vain(campaign)]))


def _write_nominal(
    folder: CampaignFolder, campaign: Experiment, plans: Mapping[str, Plan], first: FirstFlights
) -> None:
    """Write the nominal flights and the reference, at the rate of the histories."""
    if (mission := campaign.simulator.mission) is None:
        return
    times = next(iter(first.trials.values())).times
    products = Products(folder, first.trials, campaign.runs)
    histories = {name: block.history[0] for name, block in first.trials.items()}
    write_nominal(folder.nominal, times, histories, campaign.channels, products.nominal.key)
    reference = mission.find_reference(next(iter(plans.values())))
    signals = mission.reference_channels
    write_reference(folder.reference, reference, signals, products.reference.key)


def _write_samples(folder: CampaignFolder, campaign: Experiment) -> None:
    """Draw the samples and write them to the folder."""
    source = campaign.make_samples()
    provenance = {"seed": str(campaign.model.seed), "design": campaign.model.sampling.design}
    provenance[KEY] = Products(folder, (), campaign.runs).samples.key
    write_samples(
        folder.samples,
        source.names,
        campaign.runs,
        source.draw,
        provenance,
        points=len(campaign.unknowns.points),
        table=campaign.parameters,
    )


def make_manifest(
    campaign: Experiment,
    inputs: FolderInputs,
    plans: Mapping[str, Plan],
    warnings: Sequence[str],
) -> Manifest:
    """Return the initial manifest of a campaign, with the warnings of its first flights."""
    from datetime import UTC, datetime

    mission = campaign.simulator.mission
    sources = [source for plan in plans.values() for source in plan.sources]
    return Manifest(
        name=campaign.model.name,
        state=RUNNING,
        runs_planned=campaign.runs,
        seed=campaign.model.seed,
        campaign_hash=inputs.identity,
        question=inputs.question,
        source_hash=campaign.simulator.engine.source,
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        versions=find_versions() | find_package_versions(sources),
        compiler=mission.find_compiler() if mission else None,
        commit=find_commit(),
        machine=find_machine(),
        command=tuple(sys.argv[1:]),
        inputs=inputs.hashes,
        warnings=(*warnings, *_find_warnings(campaign, plans)),
        repeatable=campaign.repeatability,
        file_runs=_planned_runs(campaign),
    )


def _planned_runs(campaign: Experiment) -> int | None:
    """Return the flights stated in the campaign file if they are more than requested."""
    runs = campaign.file_runs
    return runs if isinstance(runs, int) and runs > campaign.runs_at_point else None
