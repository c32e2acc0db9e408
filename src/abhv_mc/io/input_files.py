"""Cache that lets a command read each input file only once.

Checks, simulation, hashes and copies therefore use the same bytes, even if a file is edited while
the command runs.
"""

import functools
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar, cast

from abhv_mc.io.messages import Refusal, found_value

A = TypeVar("A")
T = TypeVar("T")
_held: list[dict[Any, Any]] = []  # cached file contents and results of decorated functions


@contextmanager
def reading_once() -> Iterator[None]:
    """Read each input file only once while the context is open, in all modules and threads."""
    if _held:  # In a nested context, the outer cache is used.
        yield
        return
    _held.append({})
    try:
        yield
    finally:
        _held.clear()


def made_once(make: Callable[[A], T]) -> Callable[[A], T]:
    """Decorate a function of a path so that it runs once per file in :func:`reading_once`.

    If the argument is a document instead of a path, the function is always called.
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
    """Return the bytes of a file, which are cached inside :func:`reading_once`."""
    return path.read_bytes()


def expand(
    folder: Path, patterns: Sequence[str], empty_folders: Collection[str] = ()
) -> list[Path]:
    """Return the files that match ``patterns``. Raise Refusal if a pattern matches no file."""
    files: dict[Path, None] = {}
    for i, pattern in enumerate(patterns):
        if pattern in empty_folders:
            continue
        parts = Path(pattern).parts
        if not parts or Path(pattern).is_absolute() or ".." in parts:
            expected = "a relative path inside the controller file's folder"
            raise Refusal(found_value(pattern), expected, ("files", i))
        inside = "**/*" if (folder / pattern).is_dir() else ""
        paths = sorted((folder / pattern).glob(inside) if inside else folder.glob(pattern))
        matches = [path for path in paths if path.is_file() and "__pycache__" not in path.parts]
        if not matches:
            expected = "existing files in the controller file's folder"
            raise Refusal(f"'{pattern}' matches no file", expected, ("files", i))
        for path in matches:
            if not path.resolve().is_relative_to(folder.resolve()):
                problem = f"'{pattern}' is a link to a file outside its folder, {path.resolve()}"
                raise Refusal(problem, "a file in the controller file's folder", ("files", i))
            files[path] = None
    return list(files)
