"""Status of campaign folders: manifest, holder of the lock and size."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.manifest import INTERRUPTED, RUNNING, Manifest, read_manifest
from abhv_mc.interfaces import Store
from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class Status:
    """Manifest of a campaign's folder, description of the lock's holder, and size in bytes."""

    folder: str
    manifest: Manifest
    holder: str | None
    bytes: int

    def as_entries(self) -> dict[str, Any]:
        """Return the entries of the manifest, the folder, the holder and the size, for JSON."""
        return self.manifest.as_entries() | {
            "folder": self.folder,
            "holder": self.holder,
            "bytes": self.bytes,
        }


def read_status(root: Path, store: Store, name: str = "") -> Status:
    """Return the status of the folder ``name`` of a store, whose manifest is in ``root``.

    A campaign whose manifest says ``running`` while its lock is free was killed: its state is
    ``interrupted``. Raise InputError if the folder is that of a search.
    """
    manifest = read_manifest(CampaignFolder(root).manifest)
    if manifest.search:
        raise InputError(root, "the folder is that of a search", "the folder of a campaign")
    holder, size = store.describe(name)
    if manifest.state == RUNNING and holder is None:
        manifest = replace(manifest, state=INTERRUPTED)
    return Status(str(root), manifest, holder, size)
