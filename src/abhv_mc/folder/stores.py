"""Stores of results folders, selected by a path or an address, and the status of a folder."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.request import url2pathname

from abhv_mc.entry_points import STORES, find_entry_points
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.folder.manifest import INTERRUPTED, RUNNING, Manifest, read_manifest
from abhv_mc.interfaces import Store
from abhv_mc.io.address import read_address
from abhv_mc.io.messages import InputError


class LocalStore:
    """Store of results folders on this machine; see :class:`abhv_mc.interfaces.Store`.

    Commands lock the folder before they write (:mod:`abhv_mc.folder.lock`).
    """

    def __init__(self, path: Path) -> None:
        self.local = path

    @contextlib.contextmanager
    def reading(self, pattern: str = "*") -> Iterator[Path]:
        """Yield the local folder for reading."""
        yield self.local

    @contextlib.contextmanager
    def writing(self, staging: Path | None = None) -> Iterator[Path]:
        """Yield the local folder for writing."""
        yield self.local

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return the process that writes to the folder, or None, and the folder's size in bytes."""
        root = self.local / name
        return lock_holder(CampaignFolder(root).lock), _size(root)


def _size(root: Path) -> int:
    """Return the size of all files in bytes; files may disappear during a run."""
    size = 0
    for directory, _, names in os.walk(root):
        for name in names:
            with contextlib.suppress(OSError):
                size += Path(directory, name).lstat().st_size
    return size


def open_store(path: Path) -> Store:
    """Return the store for a path or address. Raise InputError for an unknown scheme."""
    address = read_address(path)
    if address is None:
        return LocalStore(path)
    scheme, _, location = address.text.partition("://")
    if scheme == "file":
        return LocalStore(Path(url2pathname(location)))
    entry = find_entry_points(STORES).get(scheme)
    if entry is None:
        raise InputError(
            "address",
            f"unknown scheme in '{address}'",
            "s3://bucket/folder, gs://bucket/folder or a path",
        )
    store = entry.load()(address)
    return store


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
