"""Where compiled code is kept on disk: a folder for exactly this source, compiler and settings."""

import contextlib
import hashlib
import os
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).parent


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


def user_folder(variable: str, default: str) -> Path:
    """This program's folder among the user's own of a kind, such as XDG_CACHE_HOME or .cache."""
    return Path(os.environ.get(variable) or Path.home() / default) / "abhv-mc"


def cache_folder(compiler: str) -> Path:
    """Folder of the code that ``compiler`` (in words: it, and its settings) makes from exactly this source."""
    name = hashlib.sha256(f"{_SOURCE} {compiler}".encode()).hexdigest()[:16]
    folder = user_folder("XDG_CACHE_HOME", ".cache") / name
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
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
    """
    if folder is None:
        yield
        return
    import fcntl

    folder = Path(folder)
    with (folder / f"{name}.lock").open("a") as lock:
        if not is_noted(folder, name):
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                with waiting():
                    fcntl.flock(lock, fcntl.LOCK_EX)
            if not is_noted(folder, name):
                for file in _files_of(folder, name):
                    file.unlink()
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
