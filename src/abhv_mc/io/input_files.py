"""The input files of a command: each is read once, so that what is checked, flown, hashed and kept are the same bytes.

Whoever edits a file while a campaign is made ready changes nothing of it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

T = TypeVar("T")


_held: list[dict[tuple[str, Path], Any]] = []  # bytes of the files read so far, and what was made of them


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


def read_input(path: Path) -> bytes:
    """A file's bytes: those read before, within :func:`reading_once`. Raises OSError."""
    return made_once("bytes", path, path.read_bytes)


def made_once(kind: str, path: Any, make: Callable[[], T]) -> T:
    """What ``make`` gives for a file, once within :func:`reading_once`, and each time for a document in its place."""
    if not _held or not isinstance(path, str | Path):
        return make()
    key = kind, Path(path).resolve()
    if key not in _held[-1]:
        _held[-1][key] = make()
    return cast(T, _held[-1][key])
