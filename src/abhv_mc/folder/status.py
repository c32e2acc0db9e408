"""Status of results folders: manifest, holder of the lock and size."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import INTERRUPTED, RUNNING, Manifest, read_manifest
from abhv_mc.interfaces import Store
from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class Status:
    """Manifest of a results folder, with the folder's lock holder and its size in bytes."""

    folder: str
    manifest: Manifest
    holder: str | None
    bytes: int

    def as_entries(self) -> dict[str, Any]:
        """Return the manifest entries, folder, lock holder and size in bytes for JSON."""
        return self.manifest.as_entries() | {
            "folder": self.folder,
            "holder": self.holder,
            "bytes": self.bytes,
        }


def read_status(root: Path, store: Store, name: str = "") -> Status:
    """Return the status of the folder ``name`` in a store; ``root`` contains its manifest.

    If the state in the manifest is ``running`` but the lock is free, the run was killed and the
    returned state is ``interrupted``. Raise InputError for the folder of a search.
    """
    manifest = read_manifest(CampaignFolder(root).manifest)
    if manifest.search:
        raise InputError(root, "the folder belongs to a search", "the folder of a campaign")
    holder, size = store.describe(name)
    if manifest.state == RUNNING and holder is None:
        manifest = replace(manifest, state=INTERRUPTED)
    return Status(str(root), manifest, holder, size)
