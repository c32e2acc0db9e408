"""The shards of a campaign as one campaign, once they are proven to be its parts."""

import contextlib
import shutil
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.campaign.file.resolve import read_held
from abhv_mc.campaign.file.user_code import check_own_code
from abhv_mc.execution.engine import Engine, check_source, make_engine
from abhv_mc.execution.runner import RunResult, healed_of, run_campaign
from abhv_mc.execution.setup import Request
from abhv_mc.folder.digest import Digest
from abhv_mc.folder.envelope_states import merge_states
from abhv_mc.folder.hashes import find_damage, read_checked
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import COMPLETE, INTERRUPTED, read_whole_manifest, write_manifest
from abhv_mc.folder.plans import flatten, read_plan
from abhv_mc.folder.samples import ROW_GROUP, SampleReader
from abhv_mc.io.documents import InputError

_NAMED = 20  # missing shards that are told
_COPYING = "copying"  # in the manifest while the parts are copied
_SAME = ("campaign_hash", "source_hash", "inputs")


def merge_campaign(
    parts: Sequence[Path], out: Path, engine: Engine | None = None, trust_code: bool = False
) -> RunResult:
    """Join complete shards in the new folder ``out``, then make what follows from all flights.

    A merge that was interrupted goes on. ``trust_code`` runs a law of the folders that this user has not flown. Raises
    InputError, before anything is written, where the parts are not all of one campaign, flown by the same code on the
    same samples and plans, each flight once; and after it where their digests do not add up.
    """
    engine = engine or make_engine()
    folders = [CampaignFolder(part) for part in parts]
    manifests = [read_whole_manifest(folder.manifest) for folder in folders]
    order = _check_parts(folders, manifests)
    first, target = folders[order[0]], CampaignFolder(out)
    check_source(first, manifests[order[0]], engine)
    merged = {key: value for key, value in manifests[order[0]].items() if key not in ("shard", "files", "healed")}
    merged |= {"state": INTERRUPTED, "merged_from": [manifests[i]["digest"] for i in order]}
    merged["wall_time_s"] = sum(manifest["wall_time_s"] for manifest in manifests)
    begun = _begun(target, merged)
    damaged: set[Path] = set()
    for folder in folders:
        with contextlib.suppress(OSError, ValueError):  # damaged, which is told next
            _check_content(first, folder, list(manifests[0]["controllers"]))
        damaged |= _find_damaged_flights(folder)
    if begun is None and out.exists() and any(path != target.lock for path in out.iterdir()):
        raise InputError(out, None, None, "a folder that is not empty", "a new or an empty one")
    check_own_code(read_campaign(first.campaign), trust_code)  # flights are flown again for their histories
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(hold_lock(folder.lock))
        stack.enter_context(hold_lock(target.lock))
        if begun is None or _COPYING in begun:
            write_manifest(target.manifest, merged | {_COPYING: True, "files": {}})  # nothing of it is to be read yet
            _copy(first, target)
            for folder in folders:
                for path in sorted(set(folder.flights.glob("*.parquet")) - damaged):
                    write_whole(target.flights / path.name, partial(shutil.copyfile, path))
            try:
                merge_states([folder.envelope_states for folder in folders], target.envelope_states)
            except ValueError as error:
                shutil.rmtree(out, ignore_errors=True)  # it was new or empty
                raise InputError(out, None, None, str(error), "shards of one campaign") from None
            files = manifests[order[0]].get("files") or {}
            copied = {name: known for name, known in files.items() if not name.startswith(target.envelope_states.name)}
            if copied:
                merged["files"] = copied  # the others' flights are proven as they are read
            write_manifest(target.manifest, merged)
    result = run_campaign(Request(target.campaign, out, trust_code=trust_code), engine)
    total = sum((Digest(int(manifest["digest"], 16)) for manifest in manifests), healed_of(result.manifest))
    if result.complete and result.manifest["digest"] != str(total):
        found = f"the digest {result.manifest['digest']}, where the parts' digests add up to {total}"
        raise InputError(out, None, None, found, "parts that nobody has changed")
    return result


def _begun(target: CampaignFolder, merged: dict[str, Any]) -> dict[str, Any] | None:
    """The manifest of a folder in which these parts have begun to be merged; None for any other."""
    if not target.manifest.exists():
        return None
    held = read_whole_manifest(target.manifest)
    same = all(held.get(key) == merged[key] for key in ("merged_from", "campaign_hash"))
    return held if same else None


def _check_parts(folders: Sequence[CampaignFolder], manifests: Sequence[dict[str, Any]]) -> list[int]:
    """The parts in the order of their flights."""
    count = None
    for folder, manifest in zip(folders, manifests, strict=True):
        shard = manifest.get("shard")
        if not shard:
            raise InputError(folder.root, None, None, "no shard of a campaign", "a folder flown with --shard i/n")
        if not manifest.keys() >= {"digest", "wall_time_s", "controllers", "files"} or not manifest["digest"]:
            raise InputError(folder.manifest, None, None, "another kind of manifest", "a shard's")
        if manifest.get("state") != COMPLETE:
            raise InputError(folder.root, None, None, f"a shard that is {manifest.get('state')}", "a complete one")
        for key in _SAME:
            if manifest.get(key) != manifests[0].get(key):
                found = f"another {key.replace('_', ' ')} than in {folders[0].root}"
                raise InputError(folder.root, None, None, found, "shards of one campaign, flown by the same code")
        count = count or shard[1]
        if shard[1] != count:
            raise InputError(folder.root, None, None, f"shard {shard[0]}/{shard[1]}", f"a shard of {count}")
    numbers = [manifest["shard"][0] for manifest in manifests]
    for i, number in enumerate(numbers):
        if number in numbers[:i]:
            raise InputError(folders[i].root, None, None, f"shard {number}/{count} a second time", "each shard once")
    missing = list(islice((k for k in range(1, int(count or 0) + 1) if k not in numbers), _NAMED))  # of any number
    if missing:
        found = f"no shard {', '.join(map(str, missing))}{', ...' * (len(missing) == _NAMED)} of {count}"
        raise InputError("merge", None, None, found, "all shards")
    return sorted(range(len(numbers)), key=numbers.__getitem__)


def _check_content(first: CampaignFolder, other: CampaignFolder, controllers: list[str]) -> None:
    """The same plans and the same samples, to the bit, and the same controller first: requirements bind it."""
    orders = [list(read_held(part, read_whole_manifest(part.manifest)).data["controllers"]) for part in (first, other)]
    if orders[0] != orders[1]:
        found = f"controllers in another order than in {first.root}"
        raise InputError(other.root, None, None, found, "shards of one campaign file")
    for name in controllers:
        ours, theirs = flatten(read_plan(first.plan(name))), flatten(read_plan(other.plan(name)))
        if any(value.tobytes() != theirs[key].tobytes() for key, value in ours.items()):
            found = f"another plan of '{name}' than in {first.root}: another machine computes other last bits"
            raise InputError(other.root, None, None, found, "shards flown with the first one's plans (run --plans DIR)")
    ours_read, theirs_read = SampleReader(first.samples), SampleReader(other.samples)
    same = (ours_read.names, ours_read.flights) == (theirs_read.names, theirs_read.flights)
    for start in range(0, ours_read.flights if same else 0, ROW_GROUP):
        stop = min(start + ROW_GROUP, ours_read.flights)
        same = same and np.array_equal(ours_read.rows(start, stop), theirs_read.rows(start, stop))
    if not same:
        raise InputError(other.root, None, None, f"other samples than in {first.root}", "shards of one campaign")


def _find_damaged_flights(folder: CampaignFolder) -> set[Path]:
    """Blocks to be flown again. Raises InputError for other files that are not as they were written."""
    manifest = read_whole_manifest(folder.manifest)
    damaged = {path for path, _ in find_damage(folder, manifest) if path.parent == folder.flights}
    apart = [folder.root / name for name in manifest.get("files", {})]
    read_checked(folder, [path for path in apart if not _is_proven_by_itself(folder, path)])
    return damaged


def _is_proven_by_itself(folder: CampaignFolder, path: Path) -> bool:
    return path.is_relative_to(folder.flights) or path.is_relative_to(folder.envelope_states)


def _copy(source: CampaignFolder, target: CampaignFolder) -> None:
    """Everything that shards have alike."""
    files = [source.campaign, source.samples, source.nominal, source.reference]
    files += [path for folder in (source.inputs, source.plans) for path in sorted(folder.rglob("*")) if path.is_file()]
    for path in files:
        write_whole(target.root / path.relative_to(source.root), partial(shutil.copyfile, path))
