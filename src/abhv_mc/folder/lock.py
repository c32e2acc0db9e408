"""One process per campaign folder: a lock that the system drops when its holder dies."""

import contextlib
import os
import platform
from collections.abc import Iterator
from pathlib import Path

from filelock import FileLock, Timeout

from abhv_mc.folder.layout import explain_os_error
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
