"""Flight plans as .npz files without pickle."""

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from abhv_mc.folder.inputs import read_folder_campaign
from abhv_mc.folder.layout import CampaignFolder, write_bytes
from abhv_mc.interfaces import REMEDY, Arrays, StoredPlans
from abhv_mc.io.input_error import InputError

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
