"""The shards of a campaign joined in one folder, once they are proven to be its parts; how any folders are joined."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.requirement_set import describe_requirement_changes
from abhv_mc.flight.repeatability import weakest
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
from abhv_mc.folder.plan_file import read_stored_parts
from abhv_mc.folder.samples import ROW_GROUP, SampleReader
from abhv_mc.io.documents import InputError

_SAME = ("source_hash", "inputs")


def order_shards(parts: Sequence[Path]) -> list[CampaignFolder]:
    """The shards in the order of their flights. Raises InputError where they are not all those of one campaign."""
    folders = [CampaignFolder(part) for part in parts]
    manifests = [read_manifest(folder.manifest) for folder in folders]
    for folder, manifest in zip(folders, manifests, strict=True):
        if manifest.shard is None:
            raise InputError(
                folder.root, "no shard of a campaign", "a folder flown with --shard i/n"
            )
        if not manifest.complete:
            raise InputError(folder.root, f"a shard that is {manifest.state}", "a complete one")
        if list(manifest.controllers) != list(
            manifests[0].controllers
        ):  # requirements bind the first
            found = f"controllers in another order than in {folders[0].root}"
            raise InputError(folder.root, found, "shards of one campaign file")
        refuse_other(
            folder, manifest, folders[0], manifests[0], _SAME, wish="shards of one campaign"
        )
        _refuse_other_campaign(folder, manifest, folders[0], manifests[0])
    numbers = [manifest.shard or (1, 1) for manifest in manifests]
    count = numbers[0][1]
    for folder, number in zip(folders, numbers, strict=True):
        if number[1] != count or numbers.count(number) > 1:
            found = f"shard {number[0]}/{number[1]}" + " a second time" * (number[1] == count)
            raise InputError(folder.root, found, f"each shard of {count} once")
    missing = [str(k) for k in range(1, count + 1) if (k, count) not in numbers]
    if missing:
        raise InputError("merge", f"no shard {', '.join(missing)} of {count}", "all shards")
    return [
        folder for _, folder in sorted(zip(numbers, folders, strict=True), key=lambda pair: pair[0])
    ]


def _refuse_other_campaign(
    folder: CampaignFolder, manifest: Manifest, first: CampaignFolder, held: Manifest
) -> None:
    """Raise InputError if a shard's rows depend on another campaign than the first one's."""
    for each in (first, folder):
        read_checked(each, [each.campaign])
    ours, theirs = read_folder_inputs(first, held), read_folder_inputs(folder, manifest)
    if ours.identity != theirs.identity:
        changes = "; ".join(describe_changes(ours, theirs, extensible=False))
        found = f"another campaign than in {first.root} ({changes})"
        raise InputError(folder.root, found, "shards of one campaign")


def refuse_other_requirements(folders: Sequence[CampaignFolder]) -> None:
    """Raise InputError if folders to join are judged by different requirements."""
    first, *others = (read_folder_inputs(each, read_manifest(each.manifest)) for each in folders)
    for folder, other in zip(folders[1:], others, strict=True):
        if changes := [*describe_requirement_changes(first.data, other.data)]:
            found = f"other requirements than in {folders[0].root} ({'; '.join(changes)})"
            wish = "one set for all: --requirements FILE, such as the campaign.yaml of one folder"
            raise InputError(folder.root, found, wish)


def join_shards(shards: Sequence[CampaignFolder], out: Path) -> None:
    """Copy complete shards, as :func:`order_shards` gave them, into ``out``: a folder that a run goes on with.

    The manifest comes last: a copy that was interrupted is begun anew, one that is whole is left as it is. Raises
    InputError, before anything is written, where the shards differ in plans or samples or are damaged (apart from
    blocks of flights, which are flown again), and where ``out`` holds anything else.
    """
    first, target = shards[0], CampaignFolder(out)
    manifests = [read_manifest(shard.manifest) for shard in shards]
    digests = tuple(manifest.digest or "" for manifest in manifests)
    if is_joined(target, digests):
        return
    damaged: set[Path] = set()
    for shard, manifest in zip(shards, manifests, strict=True):
        for path, words in find_damage(shard, manifest):
            if path.parent != shard.flights:
                raise damage_error(path, words)
            damaged.add(path)
        _check_content(first, shard, list(manifests[0].controllers))
    flyers = join_flyers(entry for manifest in manifests for entry in manifest.flown_by)
    merged = replace(manifests[0], shard=None, state=INTERRUPTED, merged_from=digests, flown_by=flyers,
                     wall_time_s=sum(manifest.wall_time_s for manifest in manifests),
                     repeatable=weakest(manifest.repeatable for manifest in manifests),
                     simulator_events=add_events(manifest.simulator_events for manifest in manifests))  # fmt: skip
    with begin_joined(shards, target, [first.campaign, first.samples]) as files:
        for shard in shards:
            for path in sorted(set(shard.flights.glob("*.parquet")) - damaged):
                write_whole(target.flights / path.name, partial(shutil.copyfile, path))
        merge_states([shard.envelope_states for shard in shards], target.envelope_states)
        write_manifest(target.manifest, replace(merged, files=files.listed()))


def _check_content(first: CampaignFolder, other: CampaignFolder, controllers: list[str]) -> None:
    """Raises InputError where two shards do not have the same plans and the same samples, to the bit."""
    refuse_other_plans(
        first, other, controllers, "shards flown with the first one's plans (run --plans DIR)"
    )
    readers = SampleReader(first.samples), SampleReader(other.samples)
    if not _same_samples(*readers):
        raise InputError(
            other.root, f"other samples than in {first.root}", "shards of one campaign"
        )


def _same_samples(a: SampleReader, b: SampleReader) -> bool:
    pieces = [
        (start, min(start + ROW_GROUP, a.flights)) for start in range(0, a.flights, ROW_GROUP)
    ]
    same = (a.names, a.flights) == (b.names, b.flights)
    return same and all(np.array_equal(a.rows(*piece), b.rows(*piece)) for piece in pieces)


def refuse_other(
    folder: CampaignFolder,
    manifest: Manifest,
    first: CampaignFolder,
    held: Manifest,
    keys: Sequence[str],
    *,
    wish: str,
) -> None:
    """Raises InputError where a manifest differs from that of the first folder in an entry of ``keys``."""
    for key in keys:
        if (this := getattr(manifest, key)) != (other := getattr(held, key)):
            flown = f" ({this}, not {other})" if key == "source_hash" else ""
            found = f"another {key.replace('_', ' ')}{flown} than in {first.root}"
            raise InputError(folder.root, found, f"{wish}, flown by the same code")


def refuse_other_plans(
    first: CampaignFolder, other: CampaignFolder, controllers: Sequence[str], wish: str
) -> None:
    """Raises InputError where two folders do not have the same plans, to the bit; a user's simulator has none."""
    for name in controllers if first.plans.exists() else ():
        ours, theirs = (read_stored_parts(folder.plan(name)) for folder in (first, other))
        if {k: v.tobytes() for k, v in ours.items()} != {k: v.tobytes() for k, v in theirs.items()}:
            found = f"another plan of '{name}' than in {first.root}: another machine computes other last bits"
            raise InputError(other.root, found, wish)


def is_joined(target: CampaignFolder, digests: tuple[str, ...]) -> bool:
    """Whether the folder holds what is joined of these already. Raises InputError where it holds anything else."""
    if not target.manifest.exists():
        target.refuse_strange(fresh=True)
        return False
    if read_manifest(target.manifest).merged_from != digests:
        raise InputError(target.root, "a folder that is not empty", "a new or an empty one")
    return True


@contextmanager
def begin_joined(
    parts: Sequence[CampaignFolder], target: CampaignFolder, also: Sequence[Path] = ()
) -> Iterator[FileHashes]:
    """Lock the parts; empty the target, which the caller has locked, and give it the first part's inputs, plans,
    nominal flights and ``also``."""
    first = parts[0]
    with ExitStack() as stack:
        for folder in parts:
            stack.enter_context(hold_lock(folder.lock))
        target.clear()
        files = stack.enter_context(record_hashes(target, {}))
        made = [path for path in (first.nominal, first.reference) if path.exists()]
        made += sorted(first.requirements.glob("*.yaml"))
        for path in (*also, *made, *first.input_files(), *sorted(first.plans.glob("*.npz"))):
            write_whole(target.root / path.relative_to(first.root), partial(_copy, path))
        yield files


def _copy(source: Path, target: Path) -> None:
    """Copy a file with its mode: programs stay executable."""
    shutil.copyfile(source, target)
    shutil.copymode(source, target)
