"""Lock of a results folder, so that only one process at a time computes its flights.

The lock is a `flock`, which the system releases when its holder ends. On file systems without
`flock` the holder creates a lease: a file with its host, process, start time, boot ID and PID
namespace. Only a process in the same namespace can know that the holder has ended.
"""

import contextlib
import fcntl
import functools
import json
import os
import platform
import secrets
import time
from collections.abc import Iterator
from pathlib import Path

from abhv_mc.cache_root import NO_LOCKS
from abhv_mc.folder.layout import explain_os_error
from abhv_mc.io.atomic_write import TEMPORARY, checks_before_writes
from abhv_mc.io.messages import InputError

_PATIENCE = 0.5  # waiting time in s: the command `runs` tests a lock by holding it briefly
_POLL = 0.01  # time in s between attempts
_SETTLE = 0.2  # time in s for another process to restore a lease that it moved by mistake
_REPEAT = "the same command after the process has ended"


def _in_use(path: Path, holder: str, remedy: str = _REPEAT) -> InputError:
    """Return the error for a lock that another process holds."""
    return InputError(
        path.parent, f"the folder is in use by {holder}", f"{remedy}, or another folder (-o DIR)"
    )


@contextlib.contextmanager
def hold_lock(path: Path) -> Iterator[None]:
    """Hold the lock file ``path`` during the context; its folder is created if necessary.

    The file and the folder are removed again if no other file was written. Raise InputError, with
    the name of the holder, if another process has the lock.
    """
    created = [folder for folder in (path.parent, *path.parent.parents) if not folder.exists()]
    earlier = set() if created else _names(path.parent)
    with contextlib.ExitStack() as stack:
        with explain_os_error(path, writing=True):
            descriptor, is_locked = _open_locked(path)
            stack.callback(os.close, descriptor)
            if path.name not in earlier:
                stack.callback(_remove_unused, path, earlier, created)
            if not is_locked:
                lease = _lease_of(path)
                text = _take_lease(lease)
                stack.callback(_drop_lease, lease, text)
                check = functools.partial(_check_lease, lease, text)
                checks_before_writes.append(check)
                stack.callback(checks_before_writes.remove, check)
        with contextlib.suppress(OSError):  # The lock also works on a full disk.
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"process {os.getpid()} on {platform.node()}".encode(), 0)
        yield


def lock_holder(path: Path) -> str | None:
    """Return a description of the lock's holder, or None if the lock is free or unknown."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _read_holder(path)
        except OSError as error:
            holder = _read_lease(_lease_of(path)) if error.errno in NO_LOCKS else None
            return None if holder is None or _has_died(holder) else _describe(holder)
        finally:
            os.close(descriptor)
    return None


def _open_locked(path: Path) -> tuple[int, bool]:
    """Return the open lock file, and whether the file system supports the lock."""
    deadline = time.monotonic() + _PATIENCE
    while True:
        path.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(
            FileNotFoundError
        ):  # The empty folder may be removed by another process.
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                if os.fstat(descriptor).st_nlink:  # The last holder may have deleted the file.
                    return descriptor, True
            except BlockingIOError:
                pass
            except OSError as error:
                if error.errno in NO_LOCKS:
                    return descriptor, False
                os.close(descriptor)
                raise
            os.close(descriptor)
        if time.monotonic() > deadline:
            raise _in_use(path, _read_holder(path))
        time.sleep(_POLL)


def _names(folder: Path) -> set[str]:
    with contextlib.suppress(OSError):
        return {entry.name for entry in folder.iterdir()}
    return set()


def _remove_unused(path: Path, before: set[str], created: list[Path]) -> None:
    """Delete the lock file and the empty folders that were created for the lock file."""
    with contextlib.suppress(OSError):
        if _names(path.parent) == {*before, path.name}:
            path.unlink()
            for folder in created:
                folder.rmdir()


def _read_holder(path: Path) -> str:
    with contextlib.suppress(OSError, ValueError):
        return path.read_text(encoding="utf-8") or "another process"
    return "another process"


def _lease_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.lease")


def _take_lease(lease: Path) -> str:
    """Create the lease, or take it over from an ended process; return the text of the lease.

    A stale lease is moved aside and read again, because another process may have replaced it.
    """
    own = platform.node(), os.getpid(), _start_of(os.getpid()), secrets.token_hex(4), _namespace()
    text = json.dumps(own)
    while not _create(lease, text):
        holder = _read_lease(lease)
        if holder is None:
            continue
        if not _has_died(holder):
            raise _held_error(lease, holder)
        moved = lease.with_name(f"{lease.name}.{secrets.token_hex(8)}{TEMPORARY}")
        with contextlib.suppress(
            FileNotFoundError
        ):  # Another process may have moved the lease first.
            lease.rename(moved)
            if _read_lease(moved) != holder:
                moved.rename(lease)
                continue
            moved.unlink()
    time.sleep(_SETTLE)
    holder = _read_lease(lease)
    if holder != text:
        raise _held_error(lease, holder or "")
    return text


def _create(lease: Path, text: str) -> bool:
    with contextlib.suppress(FileExistsError), lease.open("x", encoding="utf-8") as file:
        file.write(text)
        return True
    return False


def _drop_lease(lease: Path, text: str) -> None:
    if _read_lease(lease) == text:
        lease.unlink()


def _check_lease(lease: Path, text: str) -> None:
    """Raise InputError if the lease is no longer the lease of this process."""
    if (holder := _read_lease(lease)) != text:
        owner = f"is that of {_describe(holder)}" if holder else "was deleted"
        raise InputError(lease, f"the lease {owner}; nothing more is written", _REPEAT)


def _read_lease(lease: Path) -> str | None:
    """Return the text of a lease file, or None if it does not exist."""
    try:
        return lease.read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        return None


def _parse(text: str) -> tuple[str, int, str, str] | None:
    """Return host, process, start time and namespace, or None if the lease is incomplete."""
    try:
        host, process, start, _, *namespace = json.loads(text)
        return str(host), int(process), str(start), "".join(namespace)
    except (ValueError, TypeError):
        return None


def _describe(text: str) -> str:
    holder = _parse(text)
    return f"process {holder[1]} on {holder[0]}" if holder else "another process"


def _has_died(text: str) -> bool:
    """Return whether the holder of a lease is in this process's namespace and has ended."""
    holder = _parse(text)
    if holder is None or not holder[3] or holder[3] != _namespace():
        return False
    start = _start_of(holder[1])
    return start is None or ("" not in (start, holder[2]) and start != holder[2])


def _held_error(lease: Path, text: str) -> InputError:
    return _in_use(lease, _describe(text), f"{_REPEAT} (if it was killed: rm '{lease}')")


def _namespace() -> str:
    """Return the boot ID and the PID namespace of this process, or "" if one is unreadable."""
    with contextlib.suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{boot} {Path('/proc/self/ns/pid').readlink()}"
    return ""


def _start_of(process: int) -> str | None:
    """Return the start time of a process of this namespace on the kernel's clock.

    Return "" if the time is unknown, and None if the process has ended.
    """
    with contextlib.suppress(OSError):
        # /proc may belong to another namespace, in which the number is that of another process.
        if str(Path("/proc/self").readlink()) == str(os.getpid()):
            fields = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
            state, *values = fields.rpartition(")")[2].split()
            # Field 22 of /proc/PID/stat is the start time; a zombie process has ended.
            return None if state in "ZX" else values[18]
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return None
    except (OSError, OverflowError):
        pass
    return ""
