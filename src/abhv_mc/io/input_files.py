"""The input files of a command: each is read once, so that what is checked, flown, hashed and kept are the same bytes.

Whoever edits a file while a campaign is made ready changes nothing of it.
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
    """Let every input file be read once until the end, from whichever module and thread."""
    if _held:  # a command within a command
        yield
        return
    _held.append({})
    try:
        yield
    finally:
        _held.clear()


def made_once(make: Callable[[A], T]) -> Callable[[A], T]:
    """A function of a file, called once for each within :func:`reading_once`; each time for a document in its place."""

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
    """A file's bytes: those read before, within :func:`reading_once`. Raises OSError."""
    return path.read_bytes()
