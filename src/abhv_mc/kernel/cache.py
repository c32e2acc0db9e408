"""Where compiled code is kept on disk: a folder for exactly this source, compiler and settings."""

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
_NO_LOCKS = (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK)


def source_hash() -> str:
    """Hash of everything that compiled code is made from: its sources and numba itself; the same on every machine."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for file in sorted(_PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The source as this process has it: an edit from now on belongs to the next process.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Whether all that has been imported until now can only be the source that the folder is named after."""
    return source_hash() == _SOURCE


def cache_root() -> Path:
    """Return the writable folder of everything that the program caches, and create it.

    The first that can be written of XDG_CACHE_HOME, NUMBA_CACHE_DIR and ~/.cache; else a folder for temporary
    files, about which one warning is given and which child processes use, too.
    """
    names = ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR", "HOME", "TMPDIR")
    return _find_root(tuple(map(os.environ.get, names)))


@functools.lru_cache(maxsize=1)
def _find_root(_environment: tuple[str | None, ...]) -> Path:
    for base in _bases():
        folder = base / "abhv-mc"
        with contextlib.suppress(OSError):
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if os.access(folder, os.W_OK | os.X_OK):
                return folder
    base = Path(tempfile.gettempdir()) / f"abhv-mc-{os.getuid()}"
    is_kept = _is_private(base)
    if not is_kept:
        base = Path(tempfile.mkdtemp(prefix="abhv-mc-"))
        atexit.register(shutil.rmtree, base, ignore_errors=True)
    os.environ["XDG_CACHE_HOME"] = str(base)
    os.environ.setdefault("MPLCONFIGDIR", str(base / "matplotlib"))  # else it warns, too
    until = "" if is_kept else " until this command ends"
    words = f"no cache folder can be written: compiled code is kept in {base}{until}"
    warnings.warn(f"{words}. Set XDG_CACHE_HOME to a folder.", RuntimeWarning, stacklevel=2)
    folder = base / "abhv-mc"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def _bases() -> Iterator[Path]:
    for name in ("XDG_CACHE_HOME", "NUMBA_CACHE_DIR"):
        if os.environ.get(name):
            yield Path(os.environ[name])
    with contextlib.suppress(RuntimeError):  # no HOME, and the system does not know the user
        yield Path.home() / ".cache"


def _is_private(folder: Path) -> bool:
    """Create a folder in a place that all users share; return whether it is this user's, and closed to others."""
    try:
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=0o700)
        status = folder.lstat()
    except OSError:
        return False
    is_own = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid()
    return is_own and not status.st_mode & 0o077


def cache_folder(compiler: str) -> Path:
    """Folder of the code that ``compiler`` (in words: it, and its settings) makes from exactly this source."""
    name = hashlib.sha256(f"{_SOURCE} {compiler}".encode()).hexdigest()[:16]
    folder = cache_root() / name
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


@contextlib.contextmanager
def one_compiles(
    folder: str | Path | None,
    name: str,
    waiting: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
) -> Iterator[None]:
    """Compile ``name`` inside, or have numba load what it kept of it in ``folder`` (None: nothing is kept).

    The folder may be one above numba's. Of the processes that miss it there one is inside at a time, so that the
    others find what it has compiled; the lock goes with the process that holds it. ``waiting`` is entered while
    another one is inside. Files that have changed since they
    were noted are deleted first: numba would execute whatever they hold.

    A file system without locks needs none: several processes may compile the same, numba writes each file under
    another name and renames it, and no two processes give two kernels one name (``KernelCache``).
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
                if error.errno not in _NO_LOCKS:
                    raise
            if not is_noted(folder, name):
                for file in _files_of(folder, name):
                    file.unlink(missing_ok=True)
        yield
        if not is_noted(folder, name):
            _note(folder, name).write_text(_digest(folder, name))


def _files_of(folder: Path, name: str) -> list[Path]:
    """What numba kept of a function: MODULE.NAME-LINE... with its endings; a law's without a module."""
    return sorted(file for file in folder.rglob("*.nb[ic]") if f".{name}-" in f".{file.name}")


def _note(folder: Path, name: str) -> Path:
    return folder / f"{name}.sha256"


def _digest(folder: Path, name: str) -> str:
    files = _files_of(folder, name)
    return "".join(
        f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files
    )


def is_noted(folder: Path, name: str) -> bool:
    """Whether the folder has what numba kept of a function, as it was noted."""
    try:
        return bool(noted := _note(folder, name).read_text()) and noted == _digest(folder, name)
    except OSError:  # no note, or files that another process is deleting
        return False
