"""Requirement sets by which the flights of a folder were judged."""

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise
from typing import Any

from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.campaign.file.requirement_set import (
    JUDGING,
    RequirementChange,
    find_later_choices,
    find_requirement_changes,
)
from abhv_mc.campaign.file.systems import systems_key
from abhv_mc.folder.hashes import FileHashes
from abhv_mc.folder.inputs import read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder, write_whole
from abhv_mc.folder.manifest import Manifest, RequirementSet
from abhv_mc.io.documents import read_document, write_document
from abhv_mc.io.messages import counted

_HEAD = "Requirements by which the flights of this folder were judged, until the next set."


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
    flights = count_known_flights(manifest)
    sets = manifest.requirement_sets or (_write(folder, before, manifest.started, 0, 1),)
    added = _write(folder, after, now, flights, len(sets) + 1)
    return replace(manifest, requirement_sets=(*sets, added))


def _write(
    folder: CampaignFolder, data: Mapping[str, Any], time: str | None, flights: int, number: int
) -> RequirementSet:
    path = folder.requirements / f"{number:03d}.yaml"
    content = {key: data[key] for key in JUDGING if key in data}
    content.setdefault("requirements", [])
    content["controllers"] = list(data.get(systems_key(data)) or ())
    head = f"{_HEAD}\nSet at {time}, after {counted(flights, 'flight')} of each controller."
    write_whole(path, lambda temporary: write_document(temporary, content, head), durable=True)
    return RequirementSet(path.relative_to(folder.root).as_posix(), time, flights)


def replace_requirements(
    folder: CampaignFolder, manifest: Manifest, files: FileHashes, changed: Mapping[str, Any]
) -> Manifest:
    """Replace the requirements of a locked folder; return the new manifest."""
    before = read_folder_inputs(folder, manifest)
    judged = before.judged_by(changed)
    if [*find_requirement_changes(before.data, judged.data)]:
        manifest = add_requirement_set(folder, manifest, before.data, judged.data)
        judged.write_campaign(folder)
        manifest = files.write_manifest(manifest)
    return manifest


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
    stored: list[tuple[int, Any]] = [
        (stored_set.flights, read_document(folder.root / stored_set.file).data)
        for stored_set in manifest.requirement_sets
    ] or [(0, read_folder_inputs(folder, manifest).data)]
    if not is_stored:
        stored.append((count_known_flights(manifest), now))
    changes = tuple(
        change
        for (_, before), (flights, after) in pairwise(stored)
        if flights
        for change in find_requirement_changes(before, after)
    )
    blind = [data for flights, data in stored if not flights]
    return replace(
        campaign, later_choices=find_later_choices(blind, now, campaign.controllers)
    ), changes


def count_known_flights(manifest: Manifest) -> int:
    """Return the largest number of flights of a controller that have results."""
    return max((count.flights_done for count in manifest.controllers.values()), default=0)
