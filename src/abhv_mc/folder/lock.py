"""One process per campaign folder: a lock that the system drops when its holder dies."""

import contextlib
import errno
import fcntl
import json
import os
import platform
import stat
import time
from collections.abc import Iterator
from io import FileIO
from pathlib import Path

from abhv_mc.folder.layout import explain_os_error
from abhv_mc.io.input_error import InputError

_LONGEST = 4096  # bytes of who holds it
_HELD = (errno.EAGAIN, errno.EWOULDBLOCK, errno.EACCES)
_GLANCE = 0.5  # s: `status` and `list` hold a lock for a moment to see whether somebody else does


@contextlib.contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path``. Raises InputError, which names the holder, when another process has it."""
    with explain_os_error(path, writing=True):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = _open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)  # held open as long as the lock
    with file:
        try:
            _lock(file)
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


def _lock(file: FileIO) -> None:
    """Raises OSError where another process holds it for longer than a look takes."""
    end = time.monotonic() + _GLANCE
    while True:
        try:
            return fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in _HELD or time.monotonic() > end:
                raise
        time.sleep(0.01)


def lock_holder(path: Path) -> str | None:
    """Who holds the lock, in words; None when nobody does."""
    try:
        with _open(path, os.O_RDONLY) as file:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return None
    except FileNotFoundError:
        return None
    except OSError as error:
        return _holder(path) if error.errno in _HELD else None


def _open(path: Path, flags: int) -> FileIO:
    """Open a lock's file. Raises InputError where a link, a pipe or a file of another name has its place."""
    try:
        file = FileIO(os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o666), "rb+")
    except OSError as error:
        if error.errno in (errno.ELOOP, errno.ENXIO):
            raise _refusal(path) from None
        raise
    status = os.fstat(file.fileno())
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
        file.close()
        raise _refusal(path)
    return file


def _refusal(path: Path) -> InputError:
    return InputError(path, None, None, "something else than the lock of a campaign", "no such file, or a plain one")


def _holder(path: Path) -> str:
    try:
        with _open(path, os.O_RDONLY) as file:
            content = json.loads(file.read(_LONGEST))
        return f"process {content['pid']} on {content['host']}"
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return "another process"
