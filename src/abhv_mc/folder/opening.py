"""Opening of a campaign's folder by a run: lock, check, create and extend it."""

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
    """Locked folder with flights to resume from; ``files`` records every file written to it."""

    folder: CampaignFolder
    manifest: Manifest
    files: FileHashes


def open_folder(folder: CampaignFolder, fresh: bool, stack: ExitStack) -> FlownFolder | None:
    """Lock a folder until ``stack`` closes and check its files.

    Return None if the folder has no campaign that a run can resume. A damaged or missing block
    of flights is not an error: its flights are run again. Raise InputError for any other
    damaged file, if another process has the lock, and for a folder with other files.
    """
    # The lock is taken before the folder is read because another run may start.
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
    """Delete the campaign of a locked folder, and write the inputs and plans of a new one.

    The caller writes the manifest when all files that it lists exist; until then the folder is
    not read as a campaign.
    """
    folder.clear()
    files = stack.enter_context(record_hashes(folder, {}))
    inputs.write_copies(folder)
    inputs.write_campaign(folder)
    _write_plans(folder, plans)
    return files


def _write_plans(folder: CampaignFolder, plans: Mapping[str, Plan]) -> None:
    """Write the plans of a mission; plans of custom simulators follow from the campaign file."""
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
    """Extend a campaign by flights (``longer``), controllers (of ``plans``) or a new order of them.

    ``inputs`` are those of the requested campaign, ``merged`` and ``products`` those of the
    extended folder. Return the new manifest. A file that will be replaced is first removed from
    the manifest's list, so that a run that resumes after a kill computes it again.
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
