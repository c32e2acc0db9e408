"""Where compiled code is kept on disk: a folder for exactly this source, compiler and settings.

What lies there is loaded and executed, so a folder that somebody else could have written to is never used.
"""

import atexit
import contextlib
import functools
import hashlib
import os
import shutil
import stat
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).parent
_COMPILED_FILES = ("cache.py", "compiler_target.py", "jit.py", "jit_cuda.py", "jit_pointer.py")
_COMPILED_LAYERS = ("numerics", "world", "vehicle", "plant", "control", "flight")


def source_hash() -> str:
    """Hash of everything that compiled code is made from: its sources and numba itself; the same on every machine."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for layer in (*_COMPILED_FILES, *_COMPILED_LAYERS):
        path = _PACKAGE / layer
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(_PACKAGE).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The source as this process has it: an edit from now on belongs to the next process.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Whether all that has been imported until now can only be the source that the folder is named after."""
    return source_hash() == _SOURCE


def cache_folder(compiler: str) -> Path:
    """Folder of the code that ``compiler`` (in words: it, and its settings) makes from exactly this source."""
    name = hashlib.sha256(f"{_SOURCE} {compiler}".encode()).hexdigest()[:16]
    base = own_folder("XDG_CACHE_HOME", ".cache")
    for root in (base, _temporary_root()):
        with contextlib.suppress(OSError):  # no home, or a read-only one
            if root is not None and _is_usable(root, root / name):
                return root / name
    return _fresh_folder()


def own_folder(variable: str, default: str) -> Path | None:
    """This program's folder in the user's own one of a kind; None for a user without a home."""
    try:
        return Path(os.environ.get(variable) or Path.home() / default) / "abhv-mc"
    except RuntimeError:  # no HOME, and no entry in the password file
        return None


def _is_usable(root: Path, folder: Path) -> bool:
    """Make the folder where it is missing; whether it can be written to, and by nobody else. Raises OSError."""
    root.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.mkdir(mode=0o700, exist_ok=True)
    place = folder.resolve()
    closed = all(_is_closed(path, 0o022, 0) for path in (place, place.parent))
    # A group of one's own, which may write, is many a user's default; in a sticky folder names stay their owners'.
    above = all(_is_closed(path, 0o002, stat.S_ISVTX) for path in place.parents)
    return closed and above and os.access(folder, os.W_OK | os.X_OK)


def _is_closed(folder: Path, others: int, except_with: int) -> bool:
    """Whether it is this user's or root's, and without the permissions ``others`` or with the bit that excuses them."""
    found = folder.stat()
    ours = not hasattr(os, "getuid") or found.st_uid in (0, os.getuid())
    return ours and (not found.st_mode & others or bool(found.st_mode & except_with))


def _temporary_root() -> Path:
    """This user's folder in the system's temporary one, whose name anybody can guess: used only if it is private."""
    root = Path(tempfile.gettempdir()) / f"abhv-mc-{os.getuid() if hasattr(os, 'getuid') else 'user'}"
    with contextlib.suppress(OSError):
        root.mkdir(mode=0o700)
    return root if is_private(root) else _fresh_folder()


def is_private(folder: Path) -> bool:
    """Whether it is a folder, no link to one, that belongs to this user and that nobody else may enter."""
    try:
        found = folder.lstat()
    except OSError:
        return False
    ours = not hasattr(os, "getuid") or (found.st_uid == os.getuid() and not stat.S_IMODE(found.st_mode) & 0o077)
    return stat.S_ISDIR(found.st_mode) and ours


@functools.cache
def _fresh_folder() -> Path:
    """A private folder of a name that nobody can guess, for as long as this process lives."""
    folder = tempfile.mkdtemp(prefix="abhv-mc-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)


@contextlib.contextmanager
def one_at_a_time(file: Path) -> Iterator[None]:
    """Of the processes that come here with the same lock file, one is inside at a time, where the system can do it.

    The lock goes with the process that holds it, however that ends. A link in the file's place is not followed.
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError, ImportError):  # no fcntl, or a file system without locks
            import fcntl

            descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
            stack.callback(os.close, descriptor)
            fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield


@contextlib.contextmanager
def one_compiles(folder: str | Path | None, name: str) -> Iterator[None]:
    """Compile ``name`` inside, or have numba load what it kept of it in ``folder`` (None: nothing is kept).

    The folder may be one above numba's. Of the processes that miss it there, one is inside at a time, and the others
    find what it has compiled. Files other than those noted when they were written are deleted first: numba would
    execute whatever they hold.
    """
    if folder is None:
        yield
        return
    kept = _Kept(Path(folder), name)
    if kept.is_sound():  # nobody need wait
        before = kept.stamps()
        yield
        if kept.stamps() != before:  # compiled for arrays of another kind
            with one_at_a_time(kept.lock):
                kept.note()
        return
    with one_at_a_time(kept.lock):
        if not kept.is_sound():
            kept.delete()
        yield
        kept.note()


class _Kept:
    """What numba kept of a function: its files in a folder, and our note of their SHA-256."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name
        self._note, self.lock = folder / f"{name}.sha256", folder / f"{name}.lock"

    def _files(self) -> list[Path]:
        kinds = (".nbi", ".nbc")  # of MODULE.NAME-LINE..., a law's without a module
        found = (file for file in self._folder.rglob(f"*{self._name}-*") if file.suffix in kinds)
        return sorted(file for file in found if f".{file.name.rpartition('-')[0]}".endswith(f".{self._name}"))

    def _digest(self) -> str:
        files = self._files()
        return "".join(f"{hashlib.sha256(file.read_bytes()).hexdigest()}  {file.name}\n" for file in files)

    def stamps(self) -> list[tuple[str, int]]:
        """Which files there are, each with its time."""
        with contextlib.suppress(OSError):  # deleted meanwhile
            return [(file.name, file.stat().st_mtime_ns) for file in self._files()]
        return []

    def is_sound(self) -> bool:
        """Whether there are files, exactly as they were noted."""
        try:
            return bool(noted := self._note.read_bytes()) and noted == self._digest().encode()
        except OSError:
            return False

    def delete(self) -> None:
        for file in self._files():
            with contextlib.suppress(OSError):
                file.unlink()

    def note(self) -> None:
        with contextlib.suppress(OSError):  # no room: compiled anew the next time
            self._note.write_text(self._digest())
