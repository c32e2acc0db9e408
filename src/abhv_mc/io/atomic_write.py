"""Atomic file writing: readers see either a complete file or no file."""

import contextlib
import os
import secrets
from collections.abc import Callable, Iterator
from pathlib import Path

TEMPORARY = ".temporary"  # suffix of files that are being written
# Functions that raise an error if this process must not write any more.
checks_before_writes: list[Callable[[], None]] = []


def check_before_write() -> None:
    """Call the functions in ``checks_before_writes``."""
    for check in checks_before_writes:
        check()


@contextlib.contextmanager
def atomic_write(path: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path, whose file is renamed to ``path`` or, on error, deleted.

    The temporary path is absolute, because pyarrow interprets a relative path with a colon as an
    address. If several writers write the same file, the last one to finish wins. Missing folders
    are created. If ``durable``, wait until the content is on disk. Raise OSError if writing fails.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The leading dot hides the file from code that lists the folder.
    temporary = path.parent.absolute() / f".{path.name[:100]}.{secrets.token_hex(8)}{TEMPORARY}"
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        check_before_write()
        temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
