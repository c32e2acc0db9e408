"""The input files of a command: each is read once, so that what is checked, flown, hashed and kept are the same bytes.

Whoever edits a file while a campaign is made ready changes nothing of it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")


class _Held(NamedTuple):
    """The bytes of the files read so far, and what was made of them."""

    content: dict[Path, bytes]
    made: dict[tuple[str, Path], Any]


_held: list[_Held] = []


@contextmanager
def reading_once() -> Iterator[None]:
    """Let every input file be read once until the end, from whichever module and thread."""
    if _held:  # a command within a command
        yield
        return
    _held.append(_Held({}, {}))
    try:
        yield
    finally:
        _held.clear()


def read_input(path: Path) -> bytes:
    """A file's bytes: those read before, within :func:`reading_once`. Raises OSError."""
    if not _held:
        return path.read_bytes()
    content, key = _held[-1].content, path.resolve()
    if key not in content:
        content[key] = path.read_bytes()
    return content[key]


def made_once(kind: str, path: Any, make: Callable[[], T]) -> T:
    """What ``make`` gives for a file, which nobody may change; within :func:`reading_once` it is called once.

    A document that stands for a file is no path, and made each time.
    """
    if not _held or not isinstance(path, str | Path):
        return make()
    made, key = _held[-1].made, (kind, Path(path).resolve())
    if key not in made:
        made[key] = make()
    return made[key]
