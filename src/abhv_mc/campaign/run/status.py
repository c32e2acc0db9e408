"""What can be said of a campaign's folder without flying."""

import contextlib
from pathlib import Path
from typing import Any

from abhv_mc.io.input_error import InputError
from abhv_mc.store.folder import CampaignFolder
from abhv_mc.store.lock import lock_holder
from abhv_mc.store.manifest import INTERRUPTED, RUNNING, read_manifest

_KEYS = {"name", "state", "runs_planned", "runs_done", "controllers", "requirements", "digest", "started"}


def read_status(root: Path) -> dict[str, Any]:
    """The manifest, who holds the folder, and its size.

    A campaign whose manifest says ``running`` while nobody holds its lock was killed: its state is ``interrupted``.
    """
    folder = CampaignFolder(root)
    manifest = read_manifest(folder.manifest)
    if not manifest.keys() >= _KEYS:
        raise InputError(folder.manifest, None, None, "another kind of manifest", "a campaign's")
    holder = lock_holder(folder.lock)
    if manifest["state"] == RUNNING and holder is None:
        manifest["state"] = INTERRUPTED
    size = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
    return manifest | {"folder": str(root), "holder": holder, "bytes": size}


def find_campaigns(root: Path) -> list[dict[str, Any]]:
    """The status of every campaign's folder directly in ``root``, by name."""
    found = []
    for path in sorted(root.glob("*/manifest.json")):
        with contextlib.suppress(InputError):  # somebody else's manifest
            found.append(read_status(path.parent))
    return found
