"""How a run gets its folder: locked; begun anew, or with all that it holds proven whole; perhaps grown."""

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
    """A folder that holds flights to go on with; it stays locked, and every file that is written there is noted."""

    folder: CampaignFolder
    manifest: Manifest
    files: FileHashes


def open_folder(folder: CampaignFolder, fresh: bool, stack: ExitStack) -> FlownFolder | None:
    """Lock a folder until ``stack`` closes and check its files; None if it holds nothing that a run can resume.

    A damaged or missing block of flights is no error: its flights are run again. Raise InputError for any other
    damaged file, if another process has the lock, and for a folder that holds something else.
    """
    stack.enter_context(hold_lock(folder.lock))  # before the first look: another run may start
    if not folder.manifest.exists():
        folder.refuse_strange(fresh)
        return None
    if fresh:
        return None
    manifest = read_manifest(folder.manifest)
    files = stack.enter_context(record_hashes(folder, manifest.files))
    for path in files.paths():
        if path.parent != folder.flights and (words := files.damage(path)):
            raise damage_error(path, words)
    folder.sweep()
    return FlownFolder(folder, manifest, files)


def begin_folder(
    folder: CampaignFolder, inputs: FolderInputs, plans: Mapping[str, Plan], stack: ExitStack
) -> FileHashes:
    """Delete a campaign from a folder that open_folder has locked, and write the inputs and plans of a new one.

    The caller writes the manifest once everything it lists is there: until then nothing looks like a campaign.
    """
    folder.clear()
    files = stack.enter_context(record_hashes(folder, {}))
    inputs.write_copies(folder)
    inputs.write_campaign(folder)
    _write_plans(folder, plans)
    return files


def _write_plans(folder: CampaignFolder, plans: Mapping[str, Plan]) -> None:
    """The plans of a mission; those of flights with times of their own follow from the campaign file."""
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
    """Make room for more flights (``longer``), for the controllers of ``plans``, or for another order of controllers;
    the manifest from now on.

    ``inputs`` are of the campaign that is asked for, ``merged`` and ``products`` those of the folder from now on. What
    is about to be replaced is listed no more before it is: a run that goes on after a kill makes it anew.
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
