"""Copies of custom code in a cache folder, from which the code is run."""

import contextlib
import functools
import importlib
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType

from abhv_mc.custom_code.source import UserSource
from abhv_mc_vehicle.kernel.compiler_target import code_folder
from abhv_mc_vehicle.kernel.jit import compiler

BUILT = "abhv_built_law.so"  # file name of the library built from a law's sources
_modules: dict[
    str, dict[str, ModuleType]
] = {}  # modules of each law, by hash, while they are not in sys.modules
_lock = threading.RLock()


def laws_folder() -> Path:
    """Return the cache folder of custom code."""
    folder = code_folder(compiler()) / "laws"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


def filled_once(name: str, fill: Callable[[Path], None]) -> Path:
    """Return a cache folder, which the first process that needs it fills."""
    folder = laws_folder() / name
    if not folder.exists():
        temporary = Path(tempfile.mkdtemp(dir=folder.parent))
        fill(temporary)
        with contextlib.suppress(OSError):  # Another process may have filled the folder first.
            temporary.rename(folder)
        shutil.rmtree(temporary, ignore_errors=True)
    return folder


@functools.lru_cache(maxsize=64)
def unpack(source: UserSource) -> Path:
    """Return the cache folder with the files of a source, created if necessary."""
    files = (*source.files, (BUILT, source.library)) if source.library else source.files

    def fill(folder: Path) -> None:
        for name, content in files:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
            (folder / name).chmod(0o700)  # Some systems require libraries to be executable.

    name = f"{'built' if source.library else 'files'}_{source.hash[:24]}"
    folder = laws_folder() / name
    if folder.exists() and not _holds(folder, files):
        with (
            contextlib.suppress(FileNotFoundError),
            tempfile.TemporaryDirectory(dir=folder.parent) as aside,
        ):
            folder.rename(aside)
    return filled_once(name, fill)


def _holds(folder: Path, files: Iterable[tuple[str, bytes]]) -> bool:
    try:
        return all((folder / name).read_bytes() == content for name, content in files)
    except OSError:
        return False


@contextlib.contextmanager
def in_its_folder(source: UserSource) -> Iterator[None]:
    """Provide a context in which a law's code runs in its own folder, with its own modules.

    The law's modules are in ``sys.modules`` only inside the context, because modules of two laws
    may have the same name.
    """
    with _lock, contextlib.ExitStack() as as_before:
        folder = str(unpack(source)) if source.files else os.curdir
        as_before.enter_context(
            contextlib.chdir(folder)
        )  # The working directory is restored on exit.
        as_before.callback(sys.setrecursionlimit, sys.getrecursionlimit())
        if source.files:
            own = _modules.setdefault(source.hash, {})
            tops = {
                name.partition("/")[0].removesuffix(".py")
                for name, _ in source.files
                if name.endswith(".py")
            }
            hidden = {
                name: module
                for name, module in sys.modules.items()
                if name.partition(".")[0] in tops
            }
            for name in hidden:
                del sys.modules[name]
            sys.modules.update(own)
            sys.path.insert(0, folder)
            importlib.invalidate_caches()
            as_before.callback(_take_out, own, hidden, folder, tops)
        yield


def _take_out(
    own: dict[str, ModuleType], hidden: dict[str, ModuleType], folder: str, tops: set[str]
) -> None:
    sys.path.remove(folder)
    for name in [name for name in sys.modules if name.partition(".")[0] in tops]:
        own[name] = sys.modules.pop(name)
    sys.modules.update(hidden)
