"""Functions that lock, check, create and extend the results folder of a run."""

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace

from abhv_mc.folder.hashes import FileHashes, damage_error, record_hashes
from abhv_mc.folder.inputs import FolderInputs
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import RUNNING, Manifest, read_manifest, write_manifest
from abhv_mc.folder.plan_file import write_plan
from abhv_mc.folder.products import Products
from abhv_mc.interfaces import Plan


@dataclass(frozen=True)
class FlownFolder:
    """Locked folder with existing flights; ``files`` records each file written."""

    folder: CampaignFolder
    manifest: Manifest
    files: FileHashes


def open_folder(folder: CampaignFolder, fresh: bool, stack: ExitStack) -> FlownFolder | None:
    """Lock a folder until ``stack`` closes, and check its files.

    Return None if the folder has no campaign to resume. Flights of a damaged or missing block are
    run again. Raise InputError for any other damaged file, if another process has the lock, or if
    the folder contains files that do not belong to a campaign.
    """
    # Lock before reading, because another run may start.
    stack.enter_context(hold_lock(folder.lock))
    if not folder.manifest.exists():
        folder.refuse_foreign_files(fresh)
        return None
    if fresh:
        return None
    manifest = read_manifest(folder.manifest)
    files = stack.enter_context(record_hashes(folder, manifest.files))
    for path in files.paths():
        if path.parent != folder.flights and (damage := files.damage(path)):
            raise damage_error(path, damage)
    folder.sweep()
    return FlownFolder(folder, manifest, files)


def begin_folder(
    folder: CampaignFolder, inputs: FolderInputs, plans: Mapping[str, Plan], stack: ExitStack
) -> FileHashes:
    """Delete the campaign in a locked folder; write the inputs and plans of a new campaign.

    The caller writes the manifest when all listed files exist; until then the folder is not read as
    a campaign.
    """
    folder.clear()
    files = stack.enter_context(record_hashes(folder, {}))
    inputs.write_copies(folder)
    inputs.write_campaign(folder)
    _write_plans(folder, plans)
    return files


def _write_plans(folder: CampaignFolder, plans: Mapping[str, Plan]) -> None:
    """Write plans, except plans of custom simulators, which follow from the campaign file."""
    for name, plan in plans.items():
        if plan.timing is not None:
            write_plan(folder.plan(name), plan)


def grow_folder(
    flown: FlownFolder,
    inputs: FolderInputs,
    merged: FolderInputs,
    plans: Mapping[str, Plan],
    products: Products,
    *,
    longer: bool,
) -> Manifest:
    """Add flights (``longer``) or controllers to a campaign, or reorder its controllers.

    ``inputs`` are the inputs of the requested campaign; ``merged`` and ``products`` are the inputs
    and products of the extended folder. Return the new manifest. A file that will be replaced is
    first removed from the manifest, so that it is computed again if the process is killed.
    """
    folder, manifest, files = flown.folder, flown.manifest, flown.files
    inputs.write_copies(folder)
    _write_plans(folder, plans)
    files.forget(folder.campaign)
    products.forget_stale(files)
    if longer or plans:
        manifest = replace(manifest, state=RUNNING, runs_planned=merged.data["runs"])
    manifest = replace(
        manifest, inputs=merged.hashes, campaign_hash=merged.identity, question=merged.question
    )
    manifest = replace(manifest, files=files.listed())
    write_manifest(folder.manifest, manifest)
    merged.write_campaign(folder)
    return manifest
