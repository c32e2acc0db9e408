"""Merge of the shards of a campaign, or of campaigns that differ only in their seed."""

import contextlib
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from itertools import accumulate
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.flights.repeatability import weakest
from abhv_mc.folder.envelope_states import merge_states
from abhv_mc.folder.flights import SampleReader, read_pieces, write_block
from abhv_mc.folder.hashes import FileHashes, damage_error, find_damage, read_checked, record_hashes
from abhv_mc.folder.inputs import FolderInputs, describe_changes, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import (
    INTERRUPTED,
    Manifest,
    Pooled,
    add_events,
    join_flyers,
    read_manifest,
    shift_flyers,
)
from abhv_mc.folder.opening import read_stored_arrays
from abhv_mc.io.messages import InputError, counted, joined

_ONE_CAMPAIGN = "shards of one campaign"
_ONE_QUESTION = "campaigns that differ only in their seed and number of flights"


def order_shards(paths: Sequence[Path]) -> list[CampaignFolder]:
    """Return the shards in the order of their flights.

    Raise InputError if the folders are not all shards of one campaign.
    """
    folders = [CampaignFolder(path) for path in paths]
    manifests = [read_manifest(folder.manifest) for folder in folders]
    for folder, manifest in zip(folders, manifests, strict=True):
        if manifest.shard is None:
            raise InputError(
                folder.root, "the folder is not a shard of a campaign", "a run with --shard i/n"
            )
        if not manifest.complete:
            raise InputError(
                folder.root, f"the state of the shard is '{manifest.state}'", "a complete shard"
            )
        require_same_entries(folder, folders[0], ("source_hash", "inputs"), _ONE_CAMPAIGN)
        for shard in (folders[0], folder):
            read_checked(shard, [shard.campaign])
        first = read_folder_inputs(folders[0], manifests[0])
        inputs = read_folder_inputs(folder, manifest)
        if first.identity != inputs.identity:
            changes = "; ".join(describe_changes(first, inputs, extensible=False))
            problem = f"the campaign differs from that in {folders[0].root} ({changes})"
            raise InputError(folder.root, problem, _ONE_CAMPAIGN)
    numbers = [manifest.shard or (1, 1) for manifest in manifests]
    count = numbers[0][1]
    for folder, number in zip(folders, numbers, strict=True):
        if number[1] != count or numbers.count(number) > 1:
            is_other = f"is not one of {counted(count, 'shard')}"
            error = "is given twice" if number[1] == count else is_other
            raise InputError(
                folder.root,
                f"shard {number[0]}/{number[1]} {error}",
                f"each of the {counted(count, 'shard')} exactly once",
            )
    missing = [str(k) for k in range(1, count + 1) if (k, count) not in numbers]
    if missing:
        raise InputError(
            "merge",
            f"{'shard' if len(missing) == 1 else 'shards'} {joined(missing)} of {count} "
            f"{'is' if len(missing) == 1 else 'are'} missing",
            "all shards",
        )
    return [folders[i] for i in np.argsort([number for number, _ in numbers])]


def require_same_requirements(folders: Sequence[CampaignFolder]) -> None:
    """Raise InputError if the folders to merge have different requirements."""
    inputs = [read_folder_inputs(folder, read_manifest(folder.manifest)) for folder in folders]
    for folder, further in zip(folders[1:], inputs[1:], strict=True):
        if changes := [*map(str, find_requirement_changes(inputs[0].data, further.data))]:
            raise InputError(
                folder.root,
                f"the requirements differ from those of {folders[0].root} ({'; '.join(changes)})",
                "one set of requirements (add --requirements FILE, such as campaign.yaml of one "
                "folder)",
            )


def join_shards(shards: Sequence[CampaignFolder], out: Path) -> None:
    """Copy complete, ordered shards into ``out``; a subsequent run completes the campaign.

    The manifest is written last, so that an interrupted copy starts again. Raise InputError, before
    any file is written, if the shards differ in plans or samples, if files are damaged (except
    blocks of flights, which are run again), or if ``out`` has other content.
    """
    first, target = shards[0], CampaignFolder(out)
    manifests = [read_manifest(shard.manifest) for shard in shards]
    if is_merged(target, manifests):
        return
    damaged = set()
    for shard, manifest in zip(shards, manifests, strict=True):
        for path, damage in find_damage(shard, manifest):
            if path.parent != shard.flights:
                raise damage_error(path, damage)
            damaged.add(path)
        _check_content(first, shard, list(manifests[0].controllers))
    merged = replace(
        manifests[0],
        shard=None,
        state=INTERRUPTED,
        flown_by=join_flyers(entry for manifest in manifests for entry in manifest.flown_by),
        **_sum_entries(manifests),
    )
    with begin_merged(shards, target, [first.campaign, first.samples]) as files:
        for shard in shards:
            for path in sorted(set(shard.flights.glob("*.parquet")) - damaged):
                write_whole(target.flights / path.name, partial(shutil.copyfile, path))
        merge_states([shard.envelope_states for shard in shards], target.envelope_states)
        files.write_manifest(merged)


def _check_content(first: CampaignFolder, other: CampaignFolder, controllers: list[str]) -> None:
    """Raise InputError if the plans or samples of two shards differ in any bit."""
    require_same_plans(
        first, other, controllers, "shards run with the plans of the first shard (run --plans DIR)"
    )
    a, b = SampleReader(first.samples), SampleReader(other.samples)
    if (a.names, a.flights) != (b.names, b.flights) or not a.agrees(b.rows):
        raise InputError(
            other.root, f"the samples differ from those of {first.root}", _ONE_CAMPAIGN
        )


def require_same_entries(
    folder: CampaignFolder, first: CampaignFolder, keys: Sequence[str], expected: str
) -> None:
    """Raise InputError if the manifests of two folders differ in an entry of ``keys``."""
    manifests = [read_manifest(path.manifest) for path in (folder, first)]
    for key in keys:
        own, other = (getattr(manifest, key) for manifest in manifests)
        if own != other:
            hashes = f" ({own}, not {other})" if key == "source_hash" else ""
            problem = f"the {key.replace('_', ' ')} differs from that of {first.root}{hashes}"
            raise InputError(folder.root, problem, f"{expected}, computed by the same code")


def require_same_plans(
    first: CampaignFolder, other: CampaignFolder, controllers: Sequence[str], expected: str
) -> None:
    """Raise InputError if the plans of two folders differ in any bit.

    Plans of custom simulators are not stored.
    """
    for name in controllers if first.plans.exists() else ():
        plans = [
            {key: value.tobytes() for key, value in read_stored_arrays(folder.plan(name)).items()}
            for folder in (first, other)
        ]
        if plans[0] != plans[1]:
            raise InputError(
                other.root,
                f"the plan of '{name}' differs from that in {first.root}; machines may round "
                "differently",
                expected,
            )


def _digests(manifests: Sequence[Manifest]) -> tuple[str, ...]:
    return tuple(manifest.digest or "" for manifest in manifests)


def _sum_entries(manifests: Sequence[Manifest]) -> dict[str, Any]:
    """Return the entries of a merged manifest that combine those of all manifests."""
    return {
        "merged_from": _digests(manifests),
        "wall_time_s": sum(manifest.wall_time_s for manifest in manifests),
        "repeatable": weakest(manifest.repeatable for manifest in manifests),
        "simulator_events": add_events(manifest.simulator_events for manifest in manifests),
    }


def is_merged(target: CampaignFolder, manifests: Sequence[Manifest]) -> bool:
    """Return whether the target already contains the result of merging these campaigns.

    Raise InputError if the folder has other content.
    """
    if not target.manifest.exists():
        target.refuse_foreign_files(fresh=True)
        return False
    if read_manifest(target.manifest).merged_from != _digests(manifests):
        raise InputError(target.root, "the folder is not empty", "a new or empty folder")
    return True


@contextmanager
def begin_merged(
    folders: Sequence[CampaignFolder], target: CampaignFolder, extra_files: Sequence[Path] = ()
) -> Iterator[FileHashes]:
    """Lock the folders, and start their merge in the locked target.

    The target is emptied and then receives the first folder's inputs, plans, nominal flights and
    ``extra_files``.
    """
    first = folders[0]
    with ExitStack() as stack:
        for folder in folders:
            stack.enter_context(hold_lock(folder.lock))
        target.clear()
        files = stack.enter_context(record_hashes(target, {}))
        results = [path for path in (first.nominal, first.reference) if path.exists()]
        results += sorted(first.requirements.glob("*.yaml"))
        for path in (
            *extra_files,
            *results,
            *first.input_files(),
            *sorted(first.plans.glob("*.npz")),
        ):
            # The copies of programs remain executable.
            write_whole(target.root / path.relative_to(first.root), partial(shutil.copy, path))
        yield files


def list_seeds(manifest: Manifest) -> set[int]:
    """Return the seeds of a campaign's flights."""
    return {source.seed for source in manifest.pooled or ()} or {manifest.seed}


def suggest_merge(root: Path, manifest: Manifest) -> tuple[str, str]:
    """Return a sentence that names poolable campaigns, and the command that merges them.

    Candidates are complete campaigns of random flights in the same parent folder that differ only
    in their seed. If there are no candidates, both texts are empty. Larger campaigns come first,
    because a large campaign may itself be the result of a merge.
    """
    root = root if root.name else root.resolve()
    verdicts = manifest.requirements
    if not manifest.complete or not verdicts or verdicts[0].verdict == "ESTIMATE":
        return "", ""
    candidates = []
    for path in sorted(root.resolve().parent.glob("*/manifest.json")):
        with contextlib.suppress(
            InputError
        ):  # The manifest may belong to a search instead of a campaign.
            other = read_manifest(path)
            same = (other.question, other.source_hash) == (manifest.question, manifest.source_hash)
            if same and other.complete and _required(other) == _required(manifest):
                candidates.append((-other.runs_done, root.parent / path.parent.name, other))
    descriptions, folders, seeds = [], [root], list_seeds(manifest)
    for flights, folder, other in sorted(candidates, key=lambda candidate: candidate[0]):
        if not seeds & list_seeds(other):
            counts = Counter(entry.label for entry in other.requirements)
            summary = ", ".join(f"{count} {status}" for status, count in counts.items())
            descriptions.append(f"'{folder.name}' ({counted(-flights, 'flight')}: {summary})")
            folders.append(folder)
            seeds |= list_seeds(other)
    if not descriptions:
        return "", ""
    command = ["abhv-mc", "merge", *map(str, folders), "-o", f"{root}_merged"]
    sentence = f"Campaigns with other seeds, not counted here: {'; '.join(descriptions)}."
    return sentence, shlex.join(command)


def _required(manifest: Manifest) -> list[tuple[object, ...]]:
    """Return the requirements of a campaign with their controllers."""
    keys = attrgetter("asked", "controller", "probability", "consumer_risk", "producer_risk")
    return [keys(verdict) for verdict in manifest.requirements]


def check_poolable(paths: Sequence[Path]) -> list[CampaignFolder]:
    """Check that campaigns can be pooled, and return their folders.

    Raise InputError if the campaigns differ in more than seed and number of flights, or if two of
    them have the same seed.
    """
    folders = [CampaignFolder(path) for path in paths]
    manifests = [read_manifest(folder.manifest) for folder in folders]
    first, seeds = manifests[0], set[int]()
    for folder, manifest in zip(folders, manifests, strict=True):
        if not manifest.complete or manifest.search:
            raise InputError(
                folder.root,
                f"the folder contains a search or an incomplete campaign ({manifest.state})",
                "a complete campaign",
            )
        require_same_entries(folder, folders[0], ("source_hash",), _ONE_QUESTION)
        inputs = read_folder_inputs(folder, manifest)
        if inputs.question != read_folder_inputs(folders[0], first).question:
            raise InputError(
                folder.root, f"the campaign differs from that in {folders[0].root}", _ONE_QUESTION
            )
        if repeated := seeds & list_seeds(manifest):
            problem = f"the flights of seed {min(repeated)} would be counted twice"
            raise InputError(folder.root, problem, "each seed only once")
        seeds |= list_seeds(manifest)
        sampling = inputs.data.get("sampling", INDEPENDENT)
        if sampling not in (INDEPENDENT, {"design": INDEPENDENT}):
            raise InputError(
                folder.root, "the sampling design is not random", "independent samples"
            )
        expected = "campaigns run with the plans of the first campaign (run --plans DIR)"
        require_same_plans(folders[0], folder, list(manifest.controllers), expected)
        for damage in find_damage(folder, manifest):
            raise damage_error(*damage)
    return folders


def pool_campaigns(folders: Sequence[CampaignFolder], out: Path) -> None:
    """Copy poolable campaigns into ``out``; a subsequent run completes the campaign.

    Flights are numbered consecutively. Raise InputError if ``out`` has other content.
    """
    target = CampaignFolder(out)
    manifests = [read_manifest(folder.manifest) for folder in folders]
    if is_merged(target, manifests):
        return
    sampled = [SampleReader(folder.samples).flights for folder in folders]
    completed = [
        min(count.flights_done for count in manifest.controllers.values()) for manifest in manifests
    ]
    # A campaign that stopped early has fewer flights than samples.
    counts = [min(pair) for pair in zip(sampled, completed, strict=True)]
    starts = [0, *accumulate(counts)]
    pooled: list[Pooled] = []
    for manifest, count in zip(manifests, counts, strict=True):
        pooled += manifest.pooled or (Pooled(manifest.seed, count),)
    with begin_merged(folders, target) as files:
        inputs_of_first = read_folder_inputs(folders[0], manifests[0])
        data = {
            **inputs_of_first.data,
            "runs": starts[-1],
            "seed": manifests[0].seed,
            "pooled": [vars(source) for source in pooled],
        }
        inputs = FolderInputs(
            replace(inputs_of_first.document, data=data), {}, inputs_of_first.hashes
        )
        inputs.write_campaign(target)
        for folder, start in zip(folders, starts, strict=False):
            names = SampleReader(folder.samples).names
            for path in sorted(folder.flights.glob("*.parquet")):
                for rows, _ in read_pieces(path, names):
                    write_block(
                        target.flights,
                        replace(rows, first=rows.first + start),
                        pq.read_schema(path),
                    )
        sources = zip(manifests, starts, strict=False)
        files.write_manifest(
            manifests[0],
            state=INTERRUPTED,
            pooled=tuple(pooled),
            runs_planned=starts[-1],
            campaign_hash=inputs.identity,
            flown_by=join_flyers(
                entry for source, start in sources for entry in shift_flyers(source.flown_by, start)
            ),
            stopped_at=None,
            **_sum_entries(manifests),
        )
