"""Folder of all caches of the program, which no other user can write to."""

import atexit
import contextlib
import errno
import functools
import os
import shutil
import stat
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)


def cache_root() -> Path:
    """Return the folder for all caches of the program, creating it if necessary.

    The parent folder is the first usable one of XDG_CACHE_HOME, NUMBA_CACHE_DIR and ~/.cache. A
    folder of another user, or to which all users can write, is not used, because numba would
    execute its files; a warning is issued. If none is usable, a temporary folder is used with a
    warning. Child processes use the same folder.
    """
    names = ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME", "TMPDIR")
    return _find_root(tuple(map(os.environ.get, names)))


@functools.lru_cache(maxsize=1)
def _find_root(_environment: tuple[str | None, ...]) -> Path:
    until, problems = "", list[str]()
    for base in _bases():
        folder = base / "abhv-mc"
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_safe(folder):
                problems.append(f"{folder} belongs to another user, or all users can write to it")
            elif os.access(folder, os.W_OK | os.X_OK):
                break
    else:
        base = Path(tempfile.gettempdir()) / f"abhv-mc-{os.getuid()}"
        if not _is_private(base):
            base, until = Path(tempfile.mkdtemp(prefix="abhv-mc-")), " until this command ends"
            atexit.register(shutil.rmtree, base, ignore_errors=True)
        # Without MPLCONFIGDIR, matplotlib would also warn that its folder is read-only.
        os.environ.setdefault("MPLCONFIGDIR", str(base / "matplotlib"))
        folder = base / "abhv-mc"
        folder.mkdir(mode=0o700, exist_ok=True)
        problems = problems or ["No cache folder is writable"]
    if problems:
        os.environ["XDG_CACHE_HOME"] = str(base)
        warnings.warn(
            f"{'; '.join(problems)}; compiled code is stored in {base}{until}. "
            "Set XDG_CACHE_HOME to a writable folder of your own.",
            RuntimeWarning,
            stacklevel=3,
        )
    return folder


def _is_safe(folder: Path) -> bool:
    """Return whether only this user, root, and a group that one of them chose can write."""
    status = folder.stat()
    return status.st_uid in (os.getuid(), 0) and not status.st_mode & stat.S_IWOTH


def _bases() -> Iterator[Path]:
    for name in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        if os.environ.get(name):
            yield Path(os.environ[name])
    with contextlib.suppress(RuntimeError):  # HOME may be unset and the user unknown to the system.
        yield Path.home() / ".cache"


def _is_private(folder: Path) -> bool:
    """Create a folder in a shared location; return whether only this user can access it."""
    try:
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        status = folder.lstat()
    except OSError:
        return False
    is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return is_own and not status.st_mode & 0o077
