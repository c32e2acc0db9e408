"""Campaigns of one question with different seeds: which lie beside each other, and how they become one."""

import contextlib
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import pyarrow.parquet as pq

from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.flight.repeatability import weakest
from abhv_mc.folder.flights import read_pieces, write_block
from abhv_mc.folder.hashes import damage_error, find_damage
from abhv_mc.folder.inputs import FolderInputs, read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import (
    INTERRUPTED,
    Manifest,
    Pooled,
    add_events,
    join_flyers,
    read_manifest,
    shift_flyers,
    write_manifest,
)
from abhv_mc.folder.merge import begin_joined, is_joined, refuse_other, refuse_other_plans
from abhv_mc.folder.samples import SampleReader
from abhv_mc.io.documents import InputError

_SAME = ("source_hash",)  # of campaigns whose flights may be counted together
_ONE_QUESTION = "campaigns of one question, which differ in seed and number of flights alone"


def seeds_of(manifest: Manifest) -> set[int]:
    """The seeds of a campaign's flights."""
    return {part.seed for part in manifest.pooled or ()} or {manifest.seed}


def name_siblings(root: Path, manifest: Manifest) -> tuple[str, str]:
    """What complete campaigns of the same question and code beside a folder of random flights found, and the command
    that merges them with it; two empty texts where there is none. Larger ones first: they may be merged ones."""
    root = root if root.name else root.resolve()
    asked = manifest.requirements
    if not manifest.complete or not asked or asked[0].verdict == "ESTIMATE":
        return "", ""
    beside = []
    for path in sorted(root.resolve().parent.glob("*/manifest.json")):
        with contextlib.suppress(InputError):  # of something else
            other = read_manifest(path)
            same = (other.question, other.source_hash) == (manifest.question, manifest.source_hash)
            if same and other.complete and _required(other) == _required(manifest):
                beside.append((-other.runs_done, root.parent / path.parent.name, other))
    named, folders, taken = [], [root], seeds_of(manifest)
    for flights, folder, other in sorted(beside, key=lambda one: one[0]):
        if not taken & seeds_of(other):
            verdicts = Counter(entry.verdict for entry in other.requirements)
            words = ", ".join(f"{count} {status}" for status, count in verdicts.items())
            named.append(f"{folder.name} ({-flights} flights: {words})")
            folders.append(folder)
            taken |= seeds_of(other)
    if not named:
        return "", ""
    command = ["abhv-mc", "merge", *map(str, folders), "-o", f"{root}_merged"]
    return f"The same question with other seeds, not counted here: {'; '.join(named)}.", shlex.join(
        command
    )


def _required(manifest: Manifest) -> list[tuple[object, ...]]:
    """What is required of whom."""
    return [
        (each.asked, each.controller, each.probability, each.consumer_risk, each.producer_risk)
        for each in manifest.requirements
    ]


def check_pool(parts: Sequence[Path]) -> list[CampaignFolder]:
    """The folders, where they may be joined. Raises InputError where they are not of one question, or overlap."""
    folders = [CampaignFolder(part) for part in parts]
    manifests = [read_manifest(folder.manifest) for folder in folders]
    first, taken = manifests[0], set[int]()
    for folder, manifest in zip(folders, manifests, strict=True):
        if not manifest.complete or manifest.search:
            raise InputError(
                folder.root, f"a folder that is {manifest.state}", "a complete campaign"
            )
        refuse_other(folder, manifest, folders[0], first, _SAME, wish=_ONE_QUESTION)
        questions = [
            read_folder_inputs(each, held).question
            for each, held in ((folder, manifest), (folders[0], first))
        ]
        if questions[0] != questions[1]:
            raise InputError(
                folder.root, f"another question than in {folders[0].root}", _ONE_QUESTION
            )
        if seeds := taken & seeds_of(manifest):
            found = f"flights of seed {min(seeds)} a second time"
            raise InputError(
                folder.root, found, "each seed once: its flights would be counted twice"
            )
        taken |= seeds_of(manifest)
        sampling = read_folder_inputs(folder, manifest).data.get("sampling", INDEPENDENT)
        if sampling not in (INDEPENDENT, {"design": INDEPENDENT}):
            raise InputError(folder.root, "a design that is not random", "independent flights")
        wish = "campaigns flown with the first one's plans (--plans)"
        refuse_other_plans(folders[0], folder, list(manifest.controllers), wish)
        for damage in find_damage(folder, manifest):
            raise damage_error(*damage)
    return folders


def join_seeds(folders: Sequence[CampaignFolder], out: Path) -> None:
    """Copy campaigns, as :func:`check_pool` gave them, into ``out``, their flights numbered on: a folder that a run
    goes on with. Raises InputError where ``out`` holds anything else."""
    target = CampaignFolder(out)
    manifests = [read_manifest(folder.manifest) for folder in folders]
    digests = tuple(manifest.digest or "" for manifest in manifests)
    if is_joined(target, digests):
        return
    flown = [SampleReader(folder.samples).flights for folder in folders]
    done = [
        min(each.flights_done for each in manifest.controllers.values()) for manifest in manifests
    ]
    counts = [
        min(pair) for pair in zip(flown, done, strict=True)
    ]  # fewer where it stopped when proven
    starts = [0, *accumulate(counts)]
    pooled: list[Pooled] = []
    for manifest, count in zip(manifests, counts, strict=True):
        pooled += manifest.pooled or (Pooled(manifest.seed, count),)
    with begin_joined(folders, target) as files:
        held = read_folder_inputs(folders[0], manifests[0])
        data = {
            **held.data,
            "runs": starts[-1],
            "seed": manifests[0].seed,
            "pooled": [vars(one) for one in pooled],
        }
        inputs = FolderInputs(replace(held.document, data=data), {}, held.hashes)
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
        parts = zip(manifests, starts, strict=False)
        flyers = join_flyers(
            entry for part, start in parts for entry in shift_flyers(part.flown_by, start)
        )
        merged = replace(
            manifests[0], state=INTERRUPTED, merged_from=digests, pooled=tuple(pooled), runs_planned=starts[-1],
            campaign_hash=inputs.identity, flown_by=flyers, files=files.listed(), stopped_at=None,
            wall_time_s=sum(manifest.wall_time_s for manifest in manifests),
            repeatable=weakest(manifest.repeatable for manifest in manifests),
            simulator_events=add_events(manifest.simulator_events for manifest in manifests),
        )  # fmt: skip
        write_manifest(target.manifest, merged)
