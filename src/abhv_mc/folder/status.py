"""Status of campaign folders: manifest, holder of the lock and size."""

import contextlib
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import INTERRUPTED, RUNNING, Manifest, read_manifest
from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class Status:
    """A campaign's folder: what its manifest says, who holds it, and its size in bytes."""

    folder: str
    manifest: Manifest
    holder: str | None
    bytes: int

    def as_entries(self) -> dict[str, Any]:
        """As JSON has it: the manifest's entries and these."""
        return self.manifest.as_entries() | {
            "folder": self.folder,
            "holder": self.holder,
            "bytes": self.bytes,
        }


def read_status(root: Path, seen: tuple[str | None, int] | None = None) -> Status:
    """The manifest, who holds the folder, and its size: as ``seen`` at the address that it is a copy of, if it is one.

    A campaign whose manifest says ``running`` while nobody holds its lock was killed: its state is ``interrupted``.
    """
    folder = CampaignFolder(root)
    manifest = read_manifest(folder.manifest)
    if manifest.search:
        raise InputError(root, "the flights of a search", "the folder of a campaign")
    holder, size = seen or (lock_holder(folder.lock), _size(root))
    if manifest.state == RUNNING and holder is None:
        manifest = replace(manifest, state=INTERRUPTED)
    return Status(str(root), manifest, holder, size)


def _size(root: Path) -> int:
    """Bytes of all files; a run that goes on removes some meanwhile."""
    size = 0
    for place, _, names in os.walk(root):
        for name in names:
            with contextlib.suppress(OSError):
                size += Path(place, name).lstat().st_size
    return size
