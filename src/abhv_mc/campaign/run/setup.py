"""Before a campaign flies: everything checked, then its folder made, or found and proven to be the same campaign."""

import contextlib
import sys
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.file.check import CheckedCampaign, check_campaign, read_campaign
from abhv_mc.campaign.file.config import PROCESSES, THREADS
from abhv_mc.campaign.file.own_code import check_own_code, read_trusted_plan
from abhv_mc.campaign.file.possible import find_impossible
from abhv_mc.campaign.file.resolve import (
    ResolvedCampaign,
    check_inputs,
    describe_changes,
    mend_folder,
    merge_campaigns,
    read_held,
    resolve_campaign,
)
from abhv_mc.campaign.run.batches import Fly
from abhv_mc.campaign.run.margin_plans import make_margin_plans
from abhv_mc.campaign.run.stability import describe_stability
from abhv_mc.campaign.run.trial_flights import fly_trials
from abhv_mc.flight.own_law import open_law
from abhv_mc.flight.plan import LANES, FlightPlan
from abhv_mc.io.documents import Document, InputError
from abhv_mc.own.trust import read_trusted, trust
from abhv_mc.stability.metrics import MarginPlan
from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.hashes import FileHashes, read_checked, record_hashes, refuse_links
from abhv_mc.store.histories import write_nominal, write_reference
from abhv_mc.store.lock import hold_lock
from abhv_mc.store.manifest import COMPLETE, RUNNING, read_manifest, read_whole_manifest, write_manifest
from abhv_mc.store.plans import pack_plan, write_plan
from abhv_mc.store.provenance import find_commit, find_compiler, find_machine, find_versions
from abhv_mc.store.samples import ROW_GROUP, SampleReader, write_samples
from abhv_mc.store.table_check import check_table

_NEEDED = {"name", "campaign_hash", "source_hash", "inputs", "versions", "controllers"}  # to go on with a folder
Prepare = Callable[[Path, Path, Path, str], FlightPlan]


@dataclass(frozen=True)
class Request:
    """What the command line asks for."""

    campaign: Path
    out: Path | None = None  # reports/<campaign name> by default
    runs: int | None = None
    seed: int | None = None
    controllers: tuple[str, ...] | None = None
    workers: int | None = None
    fresh: bool = False
    scheduler: str | None = None  # address of a Dask cluster's scheduler
    shard: tuple[int, int] | None = None  # (i, n): fly only part i of n, from 1
    plans_from: Path | None = None  # a campaign's folder whose plans to fly instead of new ones
    trust_code: bool = False  # run Python code of a folder that its user has not flown


@dataclass(frozen=True)
class Engine:
    """How a plan is made and flown; tests put cheap ones in their place."""

    prepare: Prepare
    fly: Fly
    source: str  # hash of the code that flies: two of them never share a campaign
    # what margins.json holds
    find_stability: Callable[[CheckedCampaign, dict[str, FlightPlan]], dict[str, Any]] | None = None
    checked: bool = False  # whether ``source`` is what cache.source_hash() must give on every machine
    isolation: str = THREADS  # where "auto" flies; processes need a ``fly`` that can be imported
    device: str = "cpu"  # or the name of a GPU
    batch: int | None = None  # flights of a block and workers, where neither the campaign nor its user says
    workers: int | None = None


@dataclass(frozen=True)
class OpenCampaign:
    """A campaign whose folder is ready to fly, and locked."""

    folder: CampaignFolder
    campaign: CheckedCampaign  # as the folder holds it
    plans: dict[str, FlightPlan]
    manifest: dict[str, Any]
    asked: tuple[str, ...]  # controllers to fly now
    files: FileHashes
    margin_plans: dict[str, MarginPlan]  # where the campaign asks for margins

    @property
    def part(self) -> tuple[int, int]:
        """First flight of this folder's shard and the one after its last; all flights without shards."""
        i, n = self.manifest.get("shard") or (1, 1)
        return self.campaign.runs * (i - 1) // n, self.campaign.runs * i // n


def make_engine() -> Engine:
    """The compiled flight."""
    from abhv_mc.cache import source_hash
    from abhv_mc.flight.prepare import prepare
    from abhv_mc.stability.metrics import fly_with_margins

    return Engine(prepare, fly_with_margins, source_hash(), describe_stability, checked=True, isolation=PROCESSES)


def record_every(document: Document, plan: FlightPlan, rate: float, kind: str) -> int:
    """Control ticks between records at ``rate``. Raises InputError when the control rate is no multiple of it."""
    ticks = 1.0 / (rate * plan.timing.tick)
    every = round(ticks)
    if every < 1 or abs(ticks - every) > 1e-9 * ticks:
        found = f"{rate:g} Hz with control ticks at {1.0 / plan.timing.tick:g} Hz"
        raise document.error(("keep", kind, "rate"), found, "a rate that divides the control rate")
    return every


def open_campaign(request: Request, engine: Engine, stack: ExitStack) -> OpenCampaign:
    """Check the request, make or find the campaign's folder, and hold its lock until ``stack`` closes.

    Raises InputError before anything is written when something is wrong.
    """
    wanted = read_campaign(request.campaign, request.runs, request.seed, request.controllers)
    folder = CampaignFolder(request.out or Path("reports") / wanted.model.name)
    for source in check_own_code(wanted, request.trust_code):
        trust(source)  # his own file: he has flown it
    _check_shard(request, wanted)
    started = folder.manifest.exists()
    if not started:
        folder.refuse_strange(request.fresh)
    else:
        stack.enter_context(hold_lock(folder.lock))
    refuse_links(folder.root)
    asked = tuple(wanted.model.controllers)
    if started and not request.fresh:
        held = read_whole_manifest(folder.manifest).get("files")
        files = stack.enter_context(record_hashes(folder.root, held or {}))
        if held is None:
            files.adopt()
        return replace(_resume(folder, wanted, engine, request, files), asked=asked)
    resolved = resolve_campaign(wanted)
    plans = _take_plans(request.plans_from, resolved, asked, engine, request.trust_code)
    plans = plans or make_plans(wanted, asked, engine)
    nominal = _try_out(wanted, plans, engine)
    margin_plans = make_margin_plans(wanted, plans, engine.device)
    if not started:
        stack.enter_context(hold_lock(folder.lock))
        if folder.manifest.exists():
            found = "a campaign that another process has started meanwhile"
            raise InputError(folder.root, None, None, found, "the same command once more")
    folder.clear()
    files = stack.enter_context(record_hashes(folder.root, {}))
    resolved.write(folder)
    for name, plan in plans.items():
        write_plan(folder.plan(name), plan)
    _write_samples(folder, wanted, files)
    _write_nominal(folder, wanted, plans, nominal)
    manifest = _new_manifest(wanted, resolved, engine) | {"warnings": find_warnings(plans, wanted)}
    if request.shard is not None:
        manifest["shard"] = list(request.shard)
    manifest["files"] = files.listed()
    write_manifest(folder.manifest, manifest)
    return OpenCampaign(folder, wanted, plans, manifest, asked, files, margin_plans)


def _check_shard(request: Request, campaign: CheckedCampaign) -> None:
    if request.shard is None:
        return
    i, n = request.shard
    if not 1 <= i <= n <= campaign.runs:
        found = f"shard {i}/{n} of {campaign.runs} flights"
        raise InputError("--shard", None, None, found, f"i/n with 1 <= i <= n <= {campaign.runs}")
    if campaign.looks:
        found = "shards of a campaign that stops when proven"
        raise InputError("--shard", None, None, found, "no 'stop': no shard sees the others' flights")


def _resume(
    folder: CampaignFolder, wanted: CheckedCampaign, engine: Engine, request: Request, files: FileHashes
) -> OpenCampaign:
    """Go on with a folder that holds the same campaign, perhaps with fewer flights or controllers."""
    shard = request.shard
    manifest = read_manifest(folder.manifest)
    if "search" in manifest:
        raise InputError(folder.root, None, None, "a folder that holds a search's flights", "another folder (-o DIR)")
    if not manifest.keys() >= _NEEDED:
        raise InputError(folder.manifest, None, None, "another kind of manifest", "a campaign's")
    held_shard = manifest.get("shard")
    if held_shard != (list(shard) if shard else None):
        words = "the whole campaign" if held_shard is None else f"shard {held_shard[0]}/{held_shard[1]}"
        raise InputError(folder.root, None, None, f"a folder that holds {words}", "that, or another folder (-o DIR)")
    resolved = resolve_campaign(wanted)
    mend_folder(folder, manifest, resolved, files)
    held = read_held(folder, manifest)
    changes = describe_changes(held, resolved, wanted.extensible)
    if changes:
        found = "a folder that holds another campaign:\n  " + "\n  ".join(changes)
        wish = "the same campaign, another folder (-o DIR), or --fresh to delete what was flown"
        raise InputError(folder.root, None, None, found, wish)
    folder.sweep()
    added = [name for name in wanted.model.controllers if name not in held.data["controllers"]]
    longer = wanted.runs > held.data["runs"]
    if longer and shard is not None:
        raise InputError(
            folder.root, None, None, "a shard of fewer flights", "another folder (-o DIR): shards do not grow"
        )
    intact = files.holds(folder.campaign)
    if not intact and wanted.runs < held.data["runs"]:
        wish = f"the same campaign with {held.data['runs']} runs, which mends it"
        raise InputError(folder.campaign, None, None, "a damaged file", wish)
    longer = longer or not intact  # or killed while it grew
    if added or longer or manifest.get("state") != COMPLETE:
        check_source(folder, manifest, engine)
    if added:
        new = make_plans(wanted, added, engine)
        _try_out(wanted, new, engine)
        for name, plan in new.items():
            write_plan(folder.plan(name), plan)
    if added or longer:
        held = merge_campaigns(held, resolved)
        held.write(folder)
        manifest |= {"state": RUNNING, "runs_planned": wanted.runs, "inputs": held.hashes}
        manifest["campaign_hash"] = held.identity
    check_inputs(folder, manifest)
    campaign = check_campaign(held.document)
    campaign = replace(campaign, model=campaign.model.model_copy(update={"execution": wanted.model.execution}))
    _write_samples(folder, campaign, files)
    if added or longer:
        manifest["files"] = files.listed()
        write_manifest(folder.manifest, manifest)
    plans = {
        name: mend_plan(folder, name, files, partial(_make_plan, campaign, name, engine), request.trust_code)
        for name in campaign.model.controllers
    }
    manifest["warnings"] = find_warnings(plans, campaign)
    if added or not (files.holds(folder.nominal) and files.holds(folder.reference)):
        _write_nominal(folder, campaign, plans, _try_out(campaign, plans, engine))
    return OpenCampaign(folder, campaign, plans, manifest, (), files, make_margin_plans(campaign, plans, engine.device))


def check_source(folder: CampaignFolder, manifest: dict[str, Any], engine: Engine) -> None:
    """Refuse to go on with other code than the one that flew so far. Raises InputError."""
    flown = manifest.get("source_hash")
    if flown != engine.source:
        device = manifest.get("machine", {}).get("device", engine.device)
        kind = "another version of the program" if device == engine.device else "another device"
        found = f"flights of {kind} (source {flown} on {device}, now {engine.source} on {engine.device})"
        raise InputError(folder.root, None, None, found, "the same again, another folder (-o DIR), or --fresh")


def make_plans(campaign: CheckedCampaign, names: Iterable[str], engine: Engine) -> dict[str, FlightPlan]:
    """The plans of some of a campaign's controllers, with what it declares. Raises InputError."""
    model = campaign.model
    check_own_code(campaign)
    made = {name: engine.prepare(model.vehicle, model.mission, model.controllers[name], name) for name in names}
    plans = {name: replace(plan, declared=campaign.declared) for name, plan in made.items()}
    if model.channels is None:
        return plans
    channels = read_trusted(model.channels)
    plans = {name: replace(plan, channels_source=channels, channels_hash=channels.hash) for name, plan in plans.items()}
    for plan in plans.values():
        with open_law(plan, LANES):  # compiled now, before anything is written
            pass
    return plans


def _make_plan(campaign: CheckedCampaign, name: str, engine: Engine) -> FlightPlan:
    return make_plans(campaign, [name], engine)[name]


def _take_plans(
    root: Path | None, resolved: ResolvedCampaign, names: tuple[str, ...], engine: Engine, trust_code: bool
) -> dict[str, FlightPlan]:
    """The plans of another folder of the same inputs; empty without one. Raises InputError where it does not fit."""
    if root is None:
        return {}
    source = CampaignFolder(root)
    manifest = read_checked(source, [source.plan(name) for name in names])
    check_source(source, manifest, engine)
    held = manifest.get("inputs") or {}
    for place, content in resolved.hashes.items():
        if held.get(place) != content and not place.startswith("inputs/samples/"):
            raise InputError(root, None, None, f"plans made from another {place}", "plans of this campaign's files")
    return {name: read_trusted_plan(source, name, trust_code) for name in names}


def mend_plan(
    folder: CampaignFolder, name: str, files: FileHashes, make: Callable[[], FlightPlan], trust_code: bool = False
) -> FlightPlan:
    """The stored plan; where it is damaged, a new one that is the same to the bit. Raises InputError without one."""
    path = folder.plan(name)
    if not files.holds(path) and files.knows(path):
        again = make()
        if not files.is_content(path, pack_plan(again)):
            found = "a damaged plan, and here it comes out otherwise"
            wish = "the plan as it was written: restore it, or --fresh to delete what was flown and fly it anew"
            raise InputError(path, None, None, found, wish)
        write_plan(path, again)
    return read_trusted_plan(folder, name, trust_code)


def find_warnings(plans: dict[str, FlightPlan], campaign: CheckedCampaign) -> list[str]:
    """What the plans say about their mission, and what of the campaign cannot come out, each sentence once."""
    plain = [warning for plan in plans.values() for warning in plan.warnings.tolist()]
    return list(
        dict.fromkeys([*plain, *(f"{error.found}; wanted {error.wanted}" for error in find_impossible(campaign))])
    )


def _try_out(
    campaign: CheckedCampaign, plans: dict[str, FlightPlan], engine: Engine
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float32]]]:
    """Fly the trials; times and history ``[time, channel]`` of each controller's nominal flight."""
    first = next(iter(plans.values()))
    record_every(campaign.document, first, campaign.model.keep.envelopes.rate, "envelopes")
    every = record_every(campaign.document, first, campaign.model.keep.histories.rate, "histories")
    flown = fly_trials(campaign, plans, engine.fly, every)
    return {name: (block.times, block.history[0]) for name, block in flown.items()}


def _write_nominal(
    folder: CampaignFolder,
    campaign: CheckedCampaign,
    plans: dict[str, FlightPlan],
    nominal: dict[str, tuple[NDArray[np.float64], NDArray[np.float32]]],
) -> None:
    """The nominal flights and the reference, at the rate of the histories."""
    first = next(iter(plans.values()))
    every = record_every(campaign.document, first, campaign.model.keep.histories.rate, "histories")
    times = next(iter(nominal.values()))[0]
    write_nominal(folder.nominal, times, {name: history for name, (_, history) in nominal.items()})
    write_reference(folder.reference, first, every)


def _write_samples(folder: CampaignFolder, campaign: CheckedCampaign, files: FileHashes) -> None:
    """Draw the samples where the folder does not hold them; those that it holds must stay."""
    source = campaign.make_samples()
    held = None
    try:
        if not files.holds(folder.samples):
            raise OSError("not as it was written")
        with contextlib.suppress(InputError):
            check_table(folder.samples)
            held = SampleReader(folder.samples)
        if held is None:
            raise OSError("no table of samples")
        held.verify()
        if held.names == tuple(source.names) and held.flights == campaign.runs:
            return
        shared = min(held.flights, campaign.runs)
        pieces = ((first, min(first + ROW_GROUP, shared)) for first in range(0, shared, ROW_GROUP))
        if held.names != tuple(source.names) or not all(
            np.array_equal(held.rows(*piece), source.draw(*piece)) for piece in pieces
        ):
            found = "samples that this version of the program does not draw"
            raise InputError(folder.samples, None, None, found, "the versions that the manifest names, or --fresh")
    except (OSError, ValueError):  # missing or truncated
        held = None
    provenance = {"seed": str(campaign.model.seed), "design": campaign.model.sampling.design}
    write_samples(folder.samples, source.names, campaign.runs, source.draw, provenance)


def _new_manifest(campaign: CheckedCampaign, resolved: ResolvedCampaign, engine: Engine) -> dict[str, Any]:
    from datetime import UTC, datetime

    return {
        "name": campaign.model.name,
        "state": RUNNING,
        "runs_planned": campaign.runs,
        "runs_done": 0,
        "runs_failed": 0,
        "seed": campaign.model.seed,
        "campaign_hash": resolved.identity,
        "source_hash": engine.source,
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "wall_time_s": 0.0,
        "digest": None,
        "digests": {},
        "controllers": {},
        "requirements": [],
        "versions": find_versions(),
        "compiler": find_compiler(),
        "commit": find_commit(),
        "machine": find_machine() | {"device": engine.device},
        "command": sys.argv[1:],
        "inputs": resolved.hashes,
    }
