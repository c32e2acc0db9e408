"""Merge of the shards of a campaign into one folder; functions common to all merges."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.flights.repeatability import weakest
from abhv_mc.folder.envelope_states import merge_states
from abhv_mc.folder.hashes import (
    FileHashes,
    damage_error,
    find_damage,
    read_checked,
    record_hashes,
)
from abhv_mc.folder.inputs import describe_changes, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import (
    INTERRUPTED,
    Manifest,
    add_events,
    join_flyers,
    read_manifest,
    write_manifest,
)
from abhv_mc.folder.plan_file import read_stored_arrays
from abhv_mc.folder.samples import ROW_GROUP, SampleReader
from abhv_mc.io.documents import InputError
from abhv_mc.io.phrases import counted, joined

_SAME = ("source_hash", "inputs")


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
        require_same_entries(
            folder, manifest, folders[0], manifests[0], _SAME, expected="shards of one campaign"
        )
        _require_same_campaign(folder, manifest, folders[0], manifests[0])
    numbers = [manifest.shard or (1, 1) for manifest in manifests]
    count = numbers[0][1]
    for folder, number in zip(folders, numbers, strict=True):
        if number[1] != count or numbers.count(number) > 1:
            is_repeated = (
                " is given twice"
                if number[1] == count
                else f" is not one of {counted(count, 'shard')}"
            )
            problem = f"shard {number[0]}/{number[1]}{is_repeated}"
            expected = f"each of the {counted(count, 'shard')} exactly once"
            raise InputError(folder.root, problem, expected)
    missing = [str(k) for k in range(1, count + 1) if (k, count) not in numbers]
    if missing:
        raise InputError(
            "merge",
            f"{'shard' if len(missing) == 1 else 'shards'} {joined(missing)} of {count} "
            f"{'is' if len(missing) == 1 else 'are'} missing",
            "all shards",
        )
    return [
        folder for _, folder in sorted(zip(numbers, folders, strict=True), key=lambda pair: pair[0])
    ]


def _require_same_campaign(
    folder: CampaignFolder, manifest: Manifest, first: CampaignFolder, first_manifest: Manifest
) -> None:
    """Raise InputError if a shard's campaign differs from the campaign of the first shard."""
    for shard in (first, folder):
        read_checked(shard, [shard.campaign])
    expected = read_folder_inputs(first, first_manifest)
    inputs = read_folder_inputs(folder, manifest)
    if expected.identity != inputs.identity:
        changes = "; ".join(describe_changes(expected, inputs, extensible=False))
        problem = f"the campaign differs from that in {first.root} ({changes})"
        raise InputError(folder.root, problem, "shards of one campaign")


def require_same_requirements(folders: Sequence[CampaignFolder]) -> None:
    """Raise InputError if the folders to merge have different requirements."""
    inputs = [read_folder_inputs(folder, read_manifest(folder.manifest)) for folder in folders]
    for folder, further in zip(folders[1:], inputs[1:], strict=True):
        if changes := [*map(str, find_requirement_changes(inputs[0].data, further.data))]:
            problem = (
                f"the requirements differ from those of {folders[0].root} ({'; '.join(changes)})"
            )
            remedy = (
                "one set of requirements (add --requirements FILE, such as campaign.yaml of one "
                "folder)"
            )
            raise InputError(folder.root, problem, remedy)


def join_shards(shards: Sequence[CampaignFolder], out: Path) -> None:
    """Copy complete, ordered shards into ``out``; a subsequent run completes the campaign.

    The manifest is written last, so that an interrupted copy starts again. Raise InputError, before
    any file is written, if the shards differ in plans or samples, if files are damaged (except
    blocks of flights, which are run again), or if ``out`` has other content.
    """
    first, target = shards[0], CampaignFolder(out)
    manifests = [read_manifest(shard.manifest) for shard in shards]
    digests = tuple(manifest.digest or "" for manifest in manifests)
    if is_merged(target, digests):
        return
    damaged: set[Path] = set()
    for shard, manifest in zip(shards, manifests, strict=True):
        for path, damage in find_damage(shard, manifest):
            if path.parent != shard.flights:
                raise damage_error(path, damage)
            damaged.add(path)
        _check_content(first, shard, list(manifests[0].controllers))
    flyers = join_flyers(entry for manifest in manifests for entry in manifest.flown_by)
    merged = replace(
        manifests[0],
        shard=None,
        state=INTERRUPTED,
        merged_from=digests,
        flown_by=flyers,
        wall_time_s=sum(manifest.wall_time_s for manifest in manifests),
        repeatable=weakest(manifest.repeatable for manifest in manifests),
        simulator_events=add_events(manifest.simulator_events for manifest in manifests),
    )
    with begin_merged(shards, target, [first.campaign, first.samples]) as files:
        for shard in shards:
            for path in sorted(set(shard.flights.glob("*.parquet")) - damaged):
                write_whole(target.flights / path.name, partial(shutil.copyfile, path))
        merge_states([shard.envelope_states for shard in shards], target.envelope_states)
        write_manifest(target.manifest, replace(merged, files=files.listed()))


def _check_content(first: CampaignFolder, other: CampaignFolder, controllers: list[str]) -> None:
    """Raise InputError if the plans or samples of two shards differ in any bit."""
    require_same_plans(
        first, other, controllers, "shards run with the plans of the first shard (run --plans DIR)"
    )
    readers = SampleReader(first.samples), SampleReader(other.samples)
    if not _same_samples(*readers):
        raise InputError(
            other.root, f"the samples differ from those of {first.root}", "shards of one campaign"
        )


def _same_samples(a: SampleReader, b: SampleReader) -> bool:
    pieces = [
        (start, min(start + ROW_GROUP, a.flights)) for start in range(0, a.flights, ROW_GROUP)
    ]
    same = (a.names, a.flights) == (b.names, b.flights)
    return same and all(np.array_equal(a.rows(*piece), b.rows(*piece)) for piece in pieces)


def require_same_entries(
    folder: CampaignFolder,
    manifest: Manifest,
    first: CampaignFolder,
    first_manifest: Manifest,
    keys: Sequence[str],
    *,
    expected: str,
) -> None:
    """Raise InputError if two manifests differ in an entry of ``keys``."""
    for key in keys:
        if (own := getattr(manifest, key)) != (other := getattr(first_manifest, key)):
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
            problem = (
                f"the plan of '{name}' differs from that in {first.root}; machines may round "
                "differently"
            )
            raise InputError(other.root, problem, expected)


def is_merged(target: CampaignFolder, digests: tuple[str, ...]) -> bool:
    """Return whether the target already contains the result of merging these campaigns.

    Raise InputError if the folder has other content.
    """
    if not target.manifest.exists():
        target.refuse_foreign_files(fresh=True)
        return False
    if read_manifest(target.manifest).merged_from != digests:
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
            write_whole(target.root / path.relative_to(first.root), partial(_copy, path))
        yield files


def _copy(source: Path, target: Path) -> None:
    """Copy a file with its mode, so that the copies of programs are executable."""
    shutil.copyfile(source, target)
    shutil.copymode(source, target)
