"""Disk cache of compiled code, with a folder for each source version and compiler."""

import contextlib
import fcntl
import hashlib
import os
import stat
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

from abhv_mc.cache_root import NO_LOCKS, cache_root
from abhv_mc.version import ROOT

_PACKAGE = Path(__file__).parent
# Files outside the package whose numbers are constants of compiled code.
_NUMBERS = [ROOT / f"abhv_mc/flights/{name}.py" for name in ("statistic", "timing")]


def source_hash() -> str:
    """Return a machine-independent hash of the kernel's source and numba's version."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for file in sorted(_PACKAGE.rglob("*.py")):
        digest.update(file.relative_to(_PACKAGE).as_posix().encode())
        digest.update(file.read_bytes())
    for file in _NUMBERS:
        digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The hash is computed once per process, so an edit of the source affects only later processes.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Return whether the source is unchanged since this process imported it."""
    return source_hash() == _SOURCE


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
