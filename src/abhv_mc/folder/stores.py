"""Campaign folders by path or address: local folders, and stores of packages for addresses."""

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
    """Campaign folders on this machine; implements :class:`abhv_mc.interfaces.Store`.

    The command that writes locks the folder itself (:mod:`abhv_mc.folder.lock`).
    """

    def __init__(self, path: Path) -> None:
        self.local = path

    @contextlib.contextmanager
    def reading(self, pattern: str = "*") -> Iterator[Path]:
        """Yield the folder."""
        yield self.local

    @contextlib.contextmanager
    def writing(self, staging: Path | None = None) -> Iterator[Path]:
        """Yield the folder."""
        yield self.local

    def describe(self, name: str = "") -> tuple[str | None, int]:
        """Return a description of the process that writes to the folder, and its size in bytes."""
        root = self.local / name
        return lock_holder(CampaignFolder(root).lock), _size(root)


def _size(root: Path) -> int:
    """Return the size of all files in bytes; a run may delete some in the meantime."""
    size = 0
    for directory, _, names in os.walk(root):
        for name in names:
            with contextlib.suppress(OSError):
                size += Path(directory, name).lstat().st_size
    return size


def open_store(path: Path) -> Store:
    """Return the store of a path or an address. Raise InputError if its scheme is unknown."""
    address = read_address(path)
    if address is None:
        return LocalStore(path)
    scheme, _, location = address.text.partition("://")
    if scheme == "file":
        return LocalStore(Path(url2pathname(location)))
    entry = find_entry_points(STORES).get(scheme)
    if entry is None:
        raise InputError(
            "address", f"'{address}'", "s3://bucket/folder, gs://bucket/folder or a path"
        )
    store: Store = entry.load()(address)
    return store
