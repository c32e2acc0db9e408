"""The input files of a command: each is read once, so that what is checked, flown, hashed and kept are the same bytes.

Whoever edits a file while a campaign is made ready changes nothing of it.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

T = TypeVar("T")


class InputFiles:
    """The bytes of the files read so far, and what was made of them."""

    def __init__(self) -> None:
        self._content: dict[Path, bytes] = {}
        self._made: dict[tuple[str, Path], object] = {}

    def read(self, path: Path) -> bytes:
        """A file's bytes. Raises OSError where it cannot be read."""
        key = path.resolve()
        if key not in self._content:
            self._content[key] = path.read_bytes()
        return self._content[key]

    def make(self, kind: str, path: Path, make: Callable[[], T]) -> T:
        """What ``make`` gives for this file, made at the first call."""
        key = kind, path.resolve()
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]  # type: ignore[return-value]


_open: list[InputFiles] = []


@contextmanager
def reading_once() -> Iterator[InputFiles]:
    """Let every input file be read once until the end, from whichever module and thread."""
    if _open:  # a command within a command
        yield _open[-1]
        return
    _open.append(InputFiles())
    try:
        yield _open[-1]
    finally:
        _open.clear()


def read_input(path: Path) -> bytes:
    """A file's bytes: those read before, within :func:`reading_once`. Raises OSError."""
    return _open[-1].read(path) if _open else path.read_bytes()


def made_once(kind: str, path: Any, make: Callable[[], T]) -> T:
    """What ``make`` gives for a file, which nobody may change; within :func:`reading_once` it is called once.

    A document that stands for a file is no path, and made each time.
    """
    return _open[-1].make(kind, Path(path), make) if _open and isinstance(path, str | Path) else make()
