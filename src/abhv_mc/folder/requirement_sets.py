"""Requirement sets by which the flights of a folder were judged."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.requirement_set import (
    JUDGING,
    describe_requirement_changes,
    find_later_choices,
)
from abhv_mc.folder.hashes import record_hashes
from abhv_mc.folder.inputs import read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.manifest import Manifest, RequirementSet, read_manifest, write_manifest
from abhv_mc.io.documents import read_document, write_document
from abhv_mc.io.phrases import counted

_HEAD = "Requirements by which the flights of this folder were judged, until the next set."


@dataclass(frozen=True)
class RequirementChange:
    """Changes of the requirements after results were known."""

    time: str  # empty if only a report uses the changed requirements
    flights: int  # number of flights per controller that were run before that time
    changes: tuple[str, ...]  # descriptions such as 'speed_error_max_mps: below 5 -> 3'


def add_requirement_set(
    folder: CampaignFolder,
    manifest: Manifest,
    before: Mapping[str, Any],
    after: Mapping[str, Any],
) -> Manifest:
    """Write the changed requirements, and the original requirements if they have no file.

    Return the manifest that lists both sets.
    """
    now = datetime.now(UTC).isoformat(timespec="seconds")
    flights = max((count.flights_done for count in manifest.controllers.values()), default=0)
    sets = manifest.requirement_sets or (_write(folder, before, manifest.started, 0, 1),)
    added = _write(folder, after, now, flights, len(sets) + 1)
    return replace(manifest, requirement_sets=(*sets, added))


def _write(
    folder: CampaignFolder, data: Mapping[str, Any], time: str | None, flights: int, number: int
) -> RequirementSet:
    path = folder.requirements / f"{number:03d}.yaml"
    content = {key: data[key] for key in JUDGING if key in data}
    content.setdefault("requirements", [])
    head = f"{_HEAD}\nSet at {time}, after {counted(flights, 'flight')} of each controller."
    write_whole(path, lambda temporary: write_document(temporary, content, head), durable=True)
    return RequirementSet(path.relative_to(folder.root).as_posix(), time, flights)


def replace_requirements(folder: CampaignFolder, campaign: Experiment) -> None:
    """Replace the requirements of a locked folder by the requirements of a campaign."""
    manifest = read_manifest(folder.manifest)
    before = read_folder_inputs(folder, manifest)
    judged = before.judged_by(campaign.document.entries)
    if not [*describe_requirement_changes(before.data, judged.data)]:
        return
    with record_hashes(folder, manifest.files) as files:
        manifest = add_requirement_set(folder, manifest, before.data, judged.data)
        judged.write_campaign(folder)
        write_manifest(folder.manifest, replace(manifest, files=files.listed()))


def mark_later_choices(
    folder: CampaignFolder, manifest: Manifest, campaign: Experiment, is_stored: bool = True
) -> tuple[Experiment, tuple[RequirementChange, ...]]:
    """Mark late requirements of a campaign; return the campaign and all late changes.

    A requirement is late if it was set after results had been seen. ``is_stored`` is true if the
    folder contains the requirements; otherwise only a report uses them.
    """
    if is_stored and not manifest.requirement_sets:
        return campaign, ()
    now = campaign.document.entries
    stored = [
        (stored_set, _read(folder, stored_set)) for stored_set in manifest.requirement_sets
    ] or [(RequirementSet("", manifest.started, 0), _read_campaign(folder))]
    if not is_stored:
        flights = max(
            (stored_set.flights_done for stored_set in manifest.controllers.values()), default=0
        )
        stored.append((RequirementSet("", "", flights), now))
    blind = [
        entry
        for stored_set, data in stored
        if not stored_set.flights
        for entry in data["requirements"]
    ]
    changes = tuple(_find_changes(stored))
    later = find_later_choices(blind, now.get("requirements") or [])
    return replace(campaign, later_choices=later), changes


def _find_changes(stored: list[tuple[RequirementSet, Any]]) -> Iterator[RequirementChange]:
    for (_, before), (changed, after) in pairwise(stored):
        changes = tuple(describe_requirement_changes(before, after))
        if changed.flights and changes:
            yield RequirementChange(changed.time or "", changed.flights, changes)


def _read(folder: CampaignFolder, stored_set: RequirementSet) -> Any:
    return read_document(folder.root / stored_set.file).data


def _read_campaign(folder: CampaignFolder) -> Any:
    data: Any = read_document(folder.campaign).data
    return {**data, "requirements": data.get("requirements") or []}
