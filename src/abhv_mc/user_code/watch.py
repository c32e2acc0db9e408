"""What a user's code opens and loads: refused by name where neither it declares it nor Python itself needs it.

An audit hook (PEP 578) sees what Python opens. Files that native libraries open on their own are not seen.
"""

import contextlib
import functools
import importlib.util
import os
import sys
import sysconfig
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any

import abhv_mc
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.cache import user_folder
from abhv_mc.kernel.compiler_target import code_folder
from abhv_mc.kernel.jit import compiler
from abhv_mc.shipped import PACKAGES
from abhv_mc.user_code.source import UserSource
from abhv_mc.user_code.unpack import unpack

_SYSTEM = (
    "/dev",
    "/etc",
    "/proc",
    "/sys",
    "/usr/lib",
    "/usr/share",
)  # clocks, locales, what the machine is
_CREATED = os.O_CREAT | os.O_TRUNC


class _Watch:
    """One law while it runs: where it may read, what it has written, and what it did first that it may not."""

    def __init__(self, source: UserSource) -> None:
        self.source = source
        self.folder = str(unpack(source)) if source.files else ""
        self.declared = {
            os.path.realpath(os.path.join(self.folder, name))  # noqa: PTH118
            for name, _ in source.files
        }
        self.written: set[str] = set()
        self.refused: InputError | None = None


_watched: ContextVar[_Watch | None] = ContextVar("watched", default=None)


@contextlib.contextmanager
def watching(source: UserSource) -> Iterator[None]:
    """Refuse what the source's code opens or loads inside beyond its files. Raises InputError, with the line."""
    _install()
    watch = _Watch(source)
    token = _watched.set(watch)
    try:
        yield
    finally:
        _watched.reset(token)
        if watch.refused is not None:  # also where the code went on without
            raise watch.refused


@functools.cache
def _install() -> None:
    _allowed()
    sys.addaudithook(_hook)


@functools.cache
def _allowed() -> tuple[str, ...]:
    """Folders that any code may read: the interpreter, installed packages, caches, the system's own."""
    folders = [
        *sysconfig.get_paths().values(),
        sys.prefix,
        sys.base_prefix,
        *(str(Path(abhv_mc.__file__).parents[1] / name) for name in PACKAGES),
    ]
    caches = [
        str(code_folder(compiler())),
        str(Path.home() / ".cache"),
        str(user_folder("XDG_CACHE_HOME", ".cache")),
    ]
    real = {os.path.realpath(folder) for folder in (*folders, *caches, *_SYSTEM)}
    return tuple(f"{folder}{os.sep}" for folder in sorted(real))


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if event not in ("open", "import", "ctypes.dlopen"):
        return
    watch = _watched.get()
    if watch is None or watch.refused is not None:
        return
    _watched.set(None)  # what is opened below is ours
    try:
        _check(watch, event, arguments)
    finally:
        _watched.set(watch)


def _check(watch: _Watch, event: str, arguments: tuple[Any, ...]) -> None:
    name = arguments[1] if event == "import" else arguments[0]
    if isinstance(name, int) or not isinstance(name, str | bytes | os.PathLike):
        return  # an open file, or a module that is found first
    path = os.fsdecode(name)
    bare = event == "ctypes.dlopen" and os.sep not in path
    real = path if bare else os.path.realpath(path)
    mode, flags = arguments[1:3] if event == "open" else (None, 0)
    if any(letter in mode for letter in "wxa") if mode else (flags or 0) & _CREATED:
        watch.written.add(real)
        return
    own = (
        Path(real).is_dir() or real in watch.written or real == os.path.realpath(watch.source.file)
    )
    inside = bool(watch.folder) and real.startswith(os.path.realpath(watch.folder) + os.sep)
    own |= real in watch.declared or (inside and "__pycache__" in real)
    if own or (not inside and real.startswith(_allowed())):
        return
    place = _find_line(watch, sys._getframe(2))
    if place is None:
        return  # not on behalf of the law
    verb = "opens" if event == "open" and not real.endswith((".py", ".pyc")) else "loads"
    short = path if bare else _shorten(watch, path)
    found = f"code that {verb} '{short}', which it does not declare"
    file, line = place
    watch.refused = InputError(file, found, f"files: [{short}] in its controller file", line)
    raise watch.refused


def _shorten(watch: _Watch, path: str) -> str:
    """A file's name as the law's user would write it: from the law's folder where it lies there."""
    shown = importlib.util.source_from_cache(path) if path.endswith(".pyc") else path
    for folder in (watch.folder, os.path.dirname(watch.source.file)):  # noqa: PTH120
        short = os.path.relpath(os.path.realpath(shown), os.path.realpath(folder or os.curdir))
        if not short.startswith(".."):
            return short
    return shown


def _find_line(watch: _Watch, frame: FrameType | None) -> tuple[str, int] | None:
    """File and line of the law's own code that is at work."""
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
