"""Where compiled code is kept on disk: a folder for exactly this source, compiler and no other."""

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

_PACKAGE = Path(__file__).parent
_COMPILED_FILES = ("code_cache.py", "machine_code.py", "jit.py", "jit_compiler.py", "jit_cuda.py")
_COMPILED_LAYERS = ("numerics", "world", "vehicle", "plant", "control", "flight")


def source_hash() -> str:
    """Hash of everything that compiled code is made from: its sources and the compiler itself."""
    digest = hashlib.sha256(f"numba {version('numba')} llvmlite {version('llvmlite')}".encode())
    for layer in (*_COMPILED_FILES, *_COMPILED_LAYERS):
        path = _PACKAGE / layer
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(file.relative_to(_PACKAGE).as_posix().encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


# The source as this process has it: what is edited from now on is another's.
_SOURCE = source_hash()


def source_unchanged() -> bool:
    """Whether what has been imported until now can only be the source that the folder is named after."""
    return source_hash() == _SOURCE


def file_hash(file: Path) -> str:
    """Hash of a file's content."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


def cache_folder() -> Path:
    """Folder of the compiled code for exactly this source."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base) / "abhv-mc" / _SOURCE
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:  # no home, or a read-only one
        folder = Path(tempfile.gettempdir()) / f"abhv-mc-{os.getuid()}" / _SOURCE
        folder.mkdir(parents=True, exist_ok=True)
    return folder


@contextlib.contextmanager
def one_at_a_time(file: Path) -> Iterator[None]:
    """Of the processes that come here with the same lock file, one is inside at a time, where the system can do it.

    The lock goes with the process that holds it, however that ends.
    """
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError, ImportError):  # no fcntl, or a file system without locks
            import fcntl

            file.parent.mkdir(parents=True, exist_ok=True)
            fcntl.flock(stack.enter_context(file.open("w")), fcntl.LOCK_EX)
        yield
