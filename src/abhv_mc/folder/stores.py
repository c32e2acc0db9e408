"""Stores of results folders; a path or an address selects the store."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from urllib.request import url2pathname

from abhv_mc.entry_points import STORES, find_entry_points
from abhv_mc.folder.layout import CampaignFolder
from abhv_mc.folder.lock import lock_holder
from abhv_mc.interfaces import Store
from abhv_mc.io.address import read_address
from abhv_mc.io.input_error import InputError


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
    store: Store = entry.load()(address)
    return store
