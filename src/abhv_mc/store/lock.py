"""One process per campaign folder: a lock that the system drops when its holder dies."""

import contextlib
import errno
import fcntl
import json
import os
import platform
from collections.abc import Iterator
from pathlib import Path

from abhv_mc.io.input_error import InputError
from abhv_mc.store.folder import told_plainly

_HELD = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)


@contextlib.contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path``. Raises InputError, which names the holder, when another process has it."""
    with told_plainly(path, writing=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("ab", buffering=0)  # held open as long as the lock
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _HELD:
                found = f"a file system without locks ({error.strerror})"
                wish = "a folder on a disk of this machine (-o DIR), or one mounted with locks (NFS: without nolock)"
                raise InputError(path.parent, None, None, found, wish) from None
            found = f"a campaign that {_holder(path)} is flying"
            raise InputError(path.parent, None, None, found, "its end, or another folder (-o DIR)") from None
        with contextlib.suppress(OSError):  # a full disk: the lock holds all the same
            file.truncate(0)
            file.write(json.dumps({"pid": os.getpid(), "host": platform.node()}).encode())
        yield


def lock_holder(path: Path) -> str | None:
    """Who holds the lock, in words; None when nobody does."""
    try:
        with path.open(encoding="utf-8") as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return None
    except FileNotFoundError:
        return None
    except OSError as error:
        return _holder(path) if error.errno in _HELD else None


def _holder(path: Path) -> str:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        return f"process {content['pid']} on {content['host']}"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
