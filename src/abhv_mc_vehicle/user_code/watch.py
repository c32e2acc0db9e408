"""Check of the files that custom code opens or loads; undeclared files are rejected.

An audit hook (PEP 578) detects files opened by Python, but not by native libraries.
"""

import contextlib
import functools
import importlib.util
import os
import sys
from collections.abc import Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any

from abhv_mc.cache_root import cache_root
from abhv_mc.custom_code.read_guard import EVENTS, ReadGuard, package_folders
from abhv_mc.custom_code.source import UserSource
from abhv_mc.io.input_error import InputError
from abhv_mc.shipped import PACKAGES
from abhv_mc.version import ROOT
from abhv_mc_vehicle.kernel.compiler_target import code_folder
from abhv_mc_vehicle.kernel.jit import compiler
from abhv_mc_vehicle.user_code.unpack import unpack

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
