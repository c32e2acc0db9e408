"""Functions that lock, check, create and extend the results folder of a run, and its plans."""

import io
import zipfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.folder.hashes import FileHashes, Products, damage_error, record_hashes
from abhv_mc.folder.inputs import FolderInputs, read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder, write_bytes
from abhv_mc.folder.lock import hold_lock
from abhv_mc.folder.manifest import RUNNING, Manifest, read_manifest
from abhv_mc.interfaces import REMEDY, Arrays, Plan, StoredPlans
from abhv_mc.io.messages import InputError


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
    manifest = files.write_manifest(
        manifest, inputs=merged.hashes, campaign_hash=merged.identity, question=merged.question
    )
    merged.write_campaign(folder)
    return manifest


T = TypeVar("T")


def write_plan(path: Path, plan: Any) -> None:
    """Write a plan's arrays of numbers and strings to a file."""
    content = io.BytesIO()
    # np.savez_compressed would take three times as long.
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, value in plan.arrays().items():
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, value, allow_pickle=False)
    write_bytes(path, content.getvalue(), durable=True)


def read_stored_arrays(path: Path) -> dict[str, np.ndarray]:
    """Read the arrays of a plan file. Raise InputError if the file is missing or damaged."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return dict(stored)
    except FileNotFoundError:
        raise InputError(path, "no such file", REMEDY) from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(path, f"the plan is damaged ({error})", REMEDY) from None


def read_plan(path: Path, rebuild: Callable[[Arrays], T]) -> T:
    """Read stored arrays and return the plan that ``rebuild`` makes from them.

    Raise InputError if the arrays are missing, damaged or rejected by ``rebuild``.
    """
    try:
        return rebuild(read_stored_arrays(path))
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(path, f"the plan is damaged ({error})", REMEDY) from None


def find_stored_plans(folder: CampaignFolder) -> StoredPlans:
    """Return the plans of a results folder, without reading them yet."""
    return StoredPlans(
        folder.root,
        lambda name, rebuild: read_plan(folder.plan(name), rebuild),
        lambda: read_folder_campaign(folder).model,
    )
