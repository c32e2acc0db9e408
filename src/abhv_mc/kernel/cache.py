"""Disk cache of compiled code, with a folder for each source version and compiler."""

import atexit
import contextlib
import errno
import fcntl
import functools
import hashlib
import os
import shutil
import stat
import tempfile
import warnings
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).parent
NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)


def source_hash() -> str:
    """Return a machine-independent hash of the kernel's source and numba's version."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for file in sorted(_PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The hash is computed once per process, so an edit of the source affects only later processes.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Return whether the source is unchanged since this process imported it."""
    return source_hash() == _SOURCE


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


def cache_folder(compiler: str) -> Path:
    """Return the cache folder for kernels that are compiled with ``compiler``.

    ``compiler`` is a string that describes the compiler's interface and settings. A group shares
    the folder if its members can write all files; otherwise each member has a folder.
    """
    name = hashlib.sha256(f"{_SOURCE} {compiler}".encode()).hexdigest()[:16]
    folder = cache_root() / name
    is_shared = folder.parent.stat().st_mode & stat.S_IWGRP
    paths = (folder, *folder.rglob("*")) if is_shared and folder.exists() else ()
    if not all(os.access(path, os.R_OK | os.W_OK) for path in paths):
        folder = folder.with_name(f"{name}-{os.getuid()}")
    folder.mkdir(mode=0o770 if is_shared else 0o700, exist_ok=True)
    return folder


@contextlib.contextmanager
def compilation_lock(
    folder: str | Path | None,
    name: str,
    waiting: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
) -> Iterator[None]:
    """Hold a lock while the function ``name`` is compiled or loaded from ``folder``.

    ``folder`` may be a parent of numba's cache folder; None means that nothing is cached. If
    several processes need a function that is not cached, one process compiles it while the others
    wait, inside the context that ``waiting`` returns, and load the result. The operating system
    releases the lock when the process ends. Cache files that do not match their stored hashes are
    deleted, because numba would execute them.

    On a file system without locks, several processes may compile the same function. The cache stays
    valid: numba writes each file under a temporary name and renames it, and ``KernelCache`` gives
    each file a unique name.
    """
    if folder is None:
        yield
        return
    folder = Path(folder)
    with (folder / f"{name}.lock").open("a") as lock:
        if not is_noted(folder, name):
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                with waiting():
                    fcntl.flock(lock, fcntl.LOCK_EX)
            except OSError as error:
                if error.errno not in NO_LOCKS:
                    raise
            if not is_noted(folder, name):
                for file in _files_of(folder, name):
                    file.unlink(missing_ok=True)
        yield
        if not is_noted(folder, name):
            _note(folder, name).write_text(_digest(folder, name))


def _files_of(folder: Path, name: str) -> list[Path]:
    """Return numba's cache files for a function: [MODULE.]NAME-LINE... with suffix nbi or nbc."""
    return sorted(file for file in folder.rglob("*.nb[ic]") if f".{name}-" in f".{file.name}")


def _note(folder: Path, name: str) -> Path:
    return folder / f"{name}.sha256"


def _digest(folder: Path, name: str) -> str:
    files = _files_of(folder, name)
    return "".join(
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files
    )


def is_noted(folder: Path, name: str) -> bool:
    """Return whether numba's files for a function in the folder match their stored hashes."""
    try:
        return bool(noted := _note(folder, name).read_text()) and noted == _digest(folder, name)
    except OSError:  # There is no stored hash, or another process is deleting the files.
        return False
