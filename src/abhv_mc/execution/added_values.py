"""Addition of metrics and histories to a folder, by a repetition of its flights."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.requirement_set import find_requirement_changes
from abhv_mc.execution.setup import AddedValuesError
from abhv_mc.flights.repeatability import ROUNDING, Repeatability, relative_difference
from abhv_mc.folder.flown_campaign import read_flown
from abhv_mc.folder.hashes import record_hashes
from abhv_mc.folder.inputs import read_folder_inputs
from abhv_mc.folder.layout import CampaignFolder, write_bytes
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import Manifest
from abhv_mc.folder.requirement_sets import add_requirement_set
from abhv_mc.io.messages import InputError, notify


def add_values(error: AddedValuesError, run: Callable[[Path], Manifest]) -> Manifest:
    """Run a campaign in a folder beside the stored one, compare all values, and replace it.

    ``run`` starts or resumes the campaign in a given folder. The stored folder does not change
    before all flights have been compared. Raise InputError if a stored value is not repeated.
    """
    stored = CampaignFolder(Path(error.file))
    added = CampaignFolder(Path(f"{stored.root}-{error.identity[:8]}"))
    notify(f"{stored.root}: {error.found}; its flights are run again in {added.root} and compared")
    manifest = run(added.root)
    if not manifest.complete:
        return manifest
    with hold_lock(stored.lock), record_hashes(added, manifest.files) as files:
        before = _compare(stored, added, manifest.repeatable)
        for path in stored.requirements.glob("*.yaml"):
            write_bytes(added.requirements / path.name, path.read_bytes())
        manifest = replace(
            manifest, requirement_sets=before.requirement_sets, started=before.started
        )
        old, new = (
            read_folder_inputs(folder, its_manifest).data
            for folder, its_manifest in ((stored, before), (added, manifest))
        )
        if [*find_requirement_changes(old, new)]:
            manifest = add_requirement_set(added, manifest, old, new)
        digests = (*(before.earlier_digests or ()), str(before.digest))
        manifest = files.write_manifest(manifest, earlier_digests=digests)
        for path in stored.root.iterdir():
            # A user's file, or results on single flights, which remain valid.
            is_kept = path not in stored.contents or path in (stored.explained, stored.replayed)
            if is_kept and not path.name.startswith(stored.lock.name):
                path.rename(added.root / path.name)
        replaced = stored.root.rename(f"{added.root}-replaced")
        added.root.rename(stored.root)
    shutil.rmtree(replaced)
    notify(f"{stored.root}: all stored values were repeated; the folder has the added values")
    return manifest


def _compare(
    stored: CampaignFolder, added: CampaignFolder, repeatable: Repeatability | None
) -> Manifest:
    """Return the manifest of ``stored``. Raise InputError if ``added`` has other values."""
    before, after = read_flown(stored.root), read_flown(added.root)
    tolerance = ROUNDING if repeatable is Repeatability.ROUNDING else 0.0
    for name, flights in before.flights.items():
        again = after.flights[name]
        rows = np.searchsorted(again.flight, flights.flight)
        for metric in flights.metrics:
            difference = relative_difference(again.metrics[metric][rows], flights.metrics[metric])
            is_other = (difference > tolerance) | (again.outcome[rows] != flights.outcome)
            if is_other.any():
                flight = flights.flight[np.argmax(is_other)]
                problem = f"flight {flight} of '{name}' does not repeat the stored {metric}"
                raise InputError(stored.root, problem, "another folder (-o DIR)")
    return before.manifest
