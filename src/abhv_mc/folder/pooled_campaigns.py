"""Search for campaigns that differ only in their seed, and merge of such campaigns."""

import contextlib
import shlex
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import pyarrow.parquet as pq

from abhv_mc.campaign.sampling.designs import INDEPENDENT
from abhv_mc.flights.repeatability import weakest
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
from abhv_mc.folder.merge import begin_merged, is_merged, require_same_entries, require_same_plans
from abhv_mc.folder.samples import SampleReader
from abhv_mc.io.documents import InputError
from abhv_mc.io.phrases import counted

_SAME = ("source_hash",)  # manifest entries that must agree in pooled campaigns
_ONE_QUESTION = "campaigns that differ only in their seed and number of flights"


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
    return [
        (
            verdict.asked,
            verdict.controller,
            verdict.probability,
            verdict.consumer_risk,
            verdict.producer_risk,
        )
        for verdict in manifest.requirements
    ]


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
        require_same_entries(folder, manifest, folders[0], first, _SAME, expected=_ONE_QUESTION)
        questions = [
            read_folder_inputs(campaign_folder, stored).question
            for campaign_folder, stored in ((folder, manifest), (folders[0], first))
        ]
        if questions[0] != questions[1]:
            raise InputError(
                folder.root, f"the campaign differs from that in {folders[0].root}", _ONE_QUESTION
            )
        if repeated := seeds & list_seeds(manifest):
            problem = f"the flights of seed {min(repeated)} would be counted twice"
            raise InputError(folder.root, problem, "each seed only once")
        seeds |= list_seeds(manifest)
        sampling = read_folder_inputs(folder, manifest).data.get("sampling", INDEPENDENT)
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
    digests = tuple(manifest.digest or "" for manifest in manifests)
    if is_merged(target, digests):
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
        flyers = join_flyers(
            entry for source, start in sources for entry in shift_flyers(source.flown_by, start)
        )
        merged = replace(
            manifests[0],
            state=INTERRUPTED,
            merged_from=digests,
            pooled=tuple(pooled),
            runs_planned=starts[-1],
            campaign_hash=inputs.identity,
            flown_by=flyers,
            files=files.listed(),
            stopped_at=None,
            wall_time_s=sum(manifest.wall_time_s for manifest in manifests),
            repeatable=weakest(manifest.repeatable for manifest in manifests),
            simulator_events=add_events(manifest.simulator_events for manifest in manifests),
        )
        write_manifest(target.manifest, merged)
