"""The input files of a command; each is read once.

Checks, simulation, hashing and copies therefore use the same bytes, even if a file is edited
meanwhile.
"""

import functools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

A = TypeVar("A")
T = TypeVar("T")
_held: list[
    dict[Any, Any]
] = []  # by function and file: bytes of the files read so far, and what was made of them


@contextmanager
def reading_once() -> Iterator[None]:
    """Read every input file at most once inside the context, in all modules and threads."""
    if _held:  # a nested command
        yield
        return
    _held.append({})
    try:
        yield
    finally:
        _held.clear()


def made_once(make: Callable[[A], T]) -> Callable[[A], T]:
    """Return a function of a path that is called once per file in :func:`reading_once`.

    A document in place of the path is processed each time.
    """

    @functools.wraps(make)
    def made(path: A) -> T:
        if not _held or not isinstance(path, str | Path):
            return make(path)
        key = make, Path(path).resolve()
        if key not in _held[-1]:
            _held[-1][key] = make(path)
        return cast(T, _held[-1][key])

    return made


@made_once
def read_input(path: Path) -> bytes:
    """Return a file's bytes, cached in :func:`reading_once`. Raise OSError."""
    return path.read_bytes()
