"""Copies of custom code, and a check of the files that the code opens or loads.

The code is run from the copies, which are in a cache folder. Undeclared files are rejected.

An audit hook (PEP 578) detects files opened by Python, but not by native libraries.
"""

import contextlib
import functools
import importlib
import importlib.util
import os
import shutil
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FrameType, ModuleType
from typing import Any

from abhv_mc.cache_root import cache_root
from abhv_mc.custom_code.read_guard import EVENTS, ReadGuard, package_folders
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import PACKAGES
from abhv_mc.version import ROOT
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


_SYSTEM = (
    "/dev",
    "/etc",
    "/proc",
    "/sys",
    "/usr/lib",
    "/usr/share",
)  # folders of system files such as clocks and locales


class _Watch:
    """State of the file check of a running law: allowed files and first violation."""

    def __init__(self, source: UserSource) -> None:
        self.source = source
        self.folder = str(unpack(source)) if source.files else ""
        declared = (os.path.join(self.folder, name) for name, _ in source.files)  # noqa: PTH118
        self.guard = ReadGuard(
            (*declared, source.file),
            studies=[self.folder] if self.folder else [],
            packages=_allowed(),
            system=_SYSTEM,
        )
        self.refused: InputError | None = None


_watched: ContextVar[_Watch | None] = ContextVar("watched", default=None)


@contextlib.contextmanager
def watching(source: UserSource) -> Iterator[None]:
    """Reject undeclared files that custom code opens inside the context.

    Raise InputError with the line that opens the file.
    """
    _install()
    watch = _Watch(source)
    token = _watched.set(watch)
    try:
        yield
    finally:
        _watched.reset(token)
        if watch.refused is not None:  # The code may have caught the error.
            raise watch.refused


@functools.cache
def _install() -> None:
    _allowed()
    sys.addaudithook(_hook)


@functools.cache
def _allowed() -> frozenset[str]:
    """Return folders that custom code may read: interpreter, installed packages, caches."""
    caches = (
        str(code_folder(compiler())),
        os.path.expanduser("~/.cache"),  # noqa: PTH111  Path raises an error without a home
        str(cache_root()),
    )
    ours = (str(ROOT / name) for name in PACKAGES)
    return frozenset({*package_folders(), *ours, *caches})


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if event not in EVENTS:
        return
    watch = _watched.get()
    if watch is None or watch.refused is not None:
        return
    _watched.set(None)  # The check itself opens files that the law does not read.
    try:
        _check(watch, event, arguments)
    finally:
        _watched.set(watch)


def _check(watch: _Watch, event: str, arguments: tuple[Any, ...]) -> None:
    for path in watch.guard.find_reads(event, arguments):
        bare = event == "ctypes.dlopen" and os.sep not in path
        real = path if bare else os.path.realpath(path)
        if Path(real).is_dir() or watch.guard.allows(real):
            continue
        location = _find_line(watch, sys._getframe(2))
        if location is None:
            return  # The law did not open the file.
        verb = "opens" if event == "open" and not real.endswith((".py", ".pyc")) else "loads"
        short = path if bare else _shorten(watch, path)
        problem = f"the code {verb} '{short}', which is not declared"
        file, line = location
        watch.refused = InputError(
            file, problem, f"'files: [{short}]' in the controller file", line
        )
        raise watch.refused


def _shorten(watch: _Watch, path: str) -> str:
    """Return the path of a file, relative to the law's folder if the file is inside it."""
    source_path = importlib.util.source_from_cache(path) if path.endswith(".pyc") else path
    for folder in (watch.folder, os.path.dirname(watch.source.file)):  # noqa: PTH120
        short = os.path.relpath(
            os.path.realpath(source_path), os.path.realpath(folder or os.curdir)
        )
        if not short.startswith(".."):
            return short
    return source_path


def _find_line(watch: _Watch, frame: FrameType | None) -> tuple[str, int] | None:
    """Return the file and line of the law's code that is running."""
    while frame is not None:
        name = frame.f_code.co_filename
        if name == watch.source.file:
            return name, frame.f_lineno
        if watch.folder and name.startswith(watch.folder + os.sep):
            return str(
                Path(watch.source.file).parent / os.path.relpath(name, watch.folder)
            ), frame.f_lineno
        frame = frame.f_back
    return None
