"""Who flies in a campaign's folder, by a lock that the system drops when its holder dies; and what can be said of it
without flying."""

import contextlib
import os
import platform
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from abhv_mc.folder.layout import CampaignFolder, explain_os_error
from abhv_mc.folder.manifest import INTERRUPTED, RUNNING, Manifest, read_manifest
from abhv_mc.io.input_error import InputError

_PATIENCE = 0.5  # s: `status` and `list` hold a lock for a moment to see whether somebody else does


@contextlib.contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path``. Raises InputError, which names the holder, when another process has it."""
    lock = FileLock(path, timeout=_PATIENCE, poll_interval=0.01)
    try:
        with explain_os_error(path, writing=True):
            path.parent.mkdir(parents=True, exist_ok=True)
            lock.acquire()
    except Timeout:
        found = f"a campaign that {_holder(path)} is flying"
        raise InputError(path.parent, found, "its end, or another folder (-o DIR)") from None
    try:
        with contextlib.suppress(OSError):  # a full disk: the lock holds all the same
            path.write_text(f"process {os.getpid()} on {platform.node()}", encoding="utf-8")
        yield
    finally:
        lock.release()


def lock_holder(path: Path) -> str | None:
    """Who holds the lock, in words; None when nobody does, or the lock cannot be tried."""
    if not path.exists():
        return None
    try:
        with FileLock(path, timeout=0.0):
            return None
    except Timeout:
        return _holder(path)
    except OSError:
        return None


def _holder(path: Path) -> str:
    with contextlib.suppress(OSError, ValueError):
        return path.read_text(encoding="utf-8") or "another process"
    return "another process"


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


def find_campaigns(
    root: Path, describe: Callable[[str], tuple[str | None, int]] | None = None
) -> list[Status]:
    """The status of every campaign's folder directly in ``root``, by name; ``describe`` as for a copy of an address."""
    found = []
    for path in sorted(root.glob("*/manifest.json")):
        with contextlib.suppress(InputError):  # somebody else's manifest
            found.append(read_status(path.parent, describe and describe(path.parent.name)))
    return found
