"""Before a campaign flies: everything checked, then its folder made, or found and proven to be the same campaign."""

import contextlib
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.file.check import CheckedCampaign, check_campaign, read_campaign
from abhv_mc.campaign.file.config import PROCESSES
from abhv_mc.campaign.file.resolve import (
    ResolvedCampaign,
    check_inputs,
    describe_changes,
    merge_campaigns,
    read_held,
    read_own_campaign,
    refuse_changes,
    resolve_campaign,
    restore_folder,
)
from abhv_mc.campaign.file.user_code import check_own_code
from abhv_mc.execution.engine import Engine, check_source
from abhv_mc.execution.margin_plans import make_margin_plans
from abhv_mc.execution.plans import find_warnings, make_plan, make_plans, record_every, restore_plan, take_plans
from abhv_mc.execution.pool import start_fork_server
from abhv_mc.execution.probe_dispersions import fly_probes
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.folder.hashes import FileHashes, record_hashes, refuse_links
from abhv_mc.folder.histories import write_nominal, write_reference
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import COMPLETE, RUNNING, read_whole_manifest, write_manifest
from abhv_mc.folder.plans import write_plan
from abhv_mc.folder.provenance import find_commit, find_compiler, find_machine, find_versions
from abhv_mc.folder.samples import ROW_GROUP, SampleReader, write_samples
from abhv_mc.folder.table_check import check_table
from abhv_mc.io.documents import InputError
from abhv_mc.stability.metrics import MarginPlan
from abhv_mc.user_code.trust import trust

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
    _start_workers(request, engine)
    resolved = resolve_campaign(wanted)
    plans = take_plans(request.plans_from, wanted, resolved, engine, request.trust_code)
    plans = plans or make_plans(wanted, asked, engine)
    nominal = _probe_dispersions(wanted, plans, engine)
    margin_plans = make_margin_plans(wanted, plans, engine.device)
    refuse_changes(wanted, resolved)
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
    campaign = read_own_campaign(folder)  # whoever edits his files from now on changes nothing here
    _write_samples(folder, campaign, files)
    _write_nominal(folder, campaign, plans, nominal)
    manifest = _new_manifest(campaign, resolved, engine) | {"warnings": find_warnings(plans, campaign)}
    if request.shard is not None:
        manifest["shard"] = list(request.shard)
    manifest["files"] = files.listed()
    write_manifest(folder.manifest, manifest)
    return OpenCampaign(folder, campaign, plans, manifest, asked, files, margin_plans)


def _start_workers(request: Request, engine: Engine) -> None:
    """Have worker processes import what they need while the campaign is made ready."""
    if request.scheduler is None and engine.isolation == PROCESSES:
        start_fork_server(engine.fly)


def _check_shard(request: Request, campaign: CheckedCampaign) -> None:
    if request.shard is None:
        return
    i, n = request.shard
    if not 1 <= i <= n <= campaign.runs:
        found = f"shard {i}/{n} of {campaign.runs} flights"
        raise InputError("--shard", None, None, found, f"i/n with 1 <= i <= n <= {campaign.runs}")
    if campaign.model.stop:
        found = "shards of a campaign that stops when proven"
        raise InputError("--shard", None, None, found, "no 'stop': no shard sees the others' flights")


def _resume(
    folder: CampaignFolder, wanted: CheckedCampaign, engine: Engine, request: Request, files: FileHashes
) -> OpenCampaign:
    """Go on with a folder that holds the same campaign, perhaps with fewer flights or controllers."""
    shard = request.shard
    manifest = read_whole_manifest(folder.manifest)
    if "search" in manifest:
        raise InputError(folder.root, None, None, "a folder that holds a search's flights", "another folder (-o DIR)")
    if not manifest.keys() >= _NEEDED:
        raise InputError(folder.manifest, None, None, "another kind of manifest", "a campaign's")
    held_shard = manifest.get("shard")
    if held_shard != (list(shard) if shard else None):
        words = "the whole campaign" if held_shard is None else f"shard {held_shard[0]}/{held_shard[1]}"
        raise InputError(folder.root, None, None, f"a folder that holds {words}", "that, or another folder (-o DIR)")
    resolved = resolve_campaign(wanted)
    restore_folder(folder, manifest, resolved, files)
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
    with_nominal = files.holds(folder.nominal) and files.holds(folder.reference)
    if added or longer or not with_nominal or manifest.get("state") != COMPLETE:
        check_source(folder, manifest, engine)
        _start_workers(request, engine)
    if added:
        new = make_plans(wanted, added, engine)
        _probe_dispersions(wanted, new, engine)
        refuse_changes(wanted, resolved)
        for name, plan in new.items():
            write_plan(folder.plan(name), plan)
    merged = merge_campaigns(held, resolved, selected=request.controllers is not None)
    judged_anew = next(iter(merged.data["controllers"])) != next(iter(held.data["controllers"]))
    if added or longer or judged_anew:
        held = merged
        held.write(folder)
        manifest |= {"inputs": held.hashes, "campaign_hash": held.identity}
    if added or longer:
        manifest |= {"state": RUNNING, "runs_planned": wanted.runs}
    check_inputs(folder, manifest)
    campaign = check_campaign(held.document)
    campaign = replace(campaign, model=campaign.model.model_copy(update={"execution": wanted.model.execution}))
    _write_samples(folder, campaign, files)
    if added or longer:
        manifest["files"] = files.listed()
        write_manifest(folder.manifest, manifest)
    plans = {
        name: restore_plan(folder, name, files, partial(make_plan, campaign, name, engine), request.trust_code)
        for name in campaign.model.controllers
    }
    if added or longer or "warnings" not in manifest:
        manifest["warnings"] = find_warnings(plans, campaign)
    if added or not with_nominal:
        _write_nominal(folder, campaign, plans, _probe_dispersions(campaign, plans, engine))
    return OpenCampaign(folder, campaign, plans, manifest, (), files, make_margin_plans(campaign, plans, engine.device))


def _probe_dispersions(
    campaign: CheckedCampaign, plans: dict[str, FlightPlan], engine: Engine
) -> dict[str, tuple[NDArray[np.float64], NDArray[np.float32]]]:
    """Fly the trials; times and history ``[time, channel]`` of each controller's nominal flight."""
    first = next(iter(plans.values()))
    record_every(campaign.document, first, campaign.model.keep.envelopes.rate, "envelopes")
    every = record_every(campaign.document, first, campaign.model.keep.histories.rate, "histories")
    flown = fly_probes(campaign, plans, engine.fly, every)
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
