"""Atomic file writing: a reader sees a complete file or none."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

TEMPORARY = ".temporary"  # ending of a file that is being written


@contextlib.contextmanager
def atomic_write(path: Path, durable: bool = False) -> Iterator[Path]:
    """Yield a temporary path; rename it to ``path`` at the end, or delete it on an error.

    The temporary path is absolute: pyarrow takes a relative one with a colon for an address. If
    several writers write the same file, the last one to finish wins. Missing folders are created;
    ``durable`` waits until the content is on disk. Raise OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The leading dot hides it from readers of the folder.
    temporary = path.parent.absolute() / f".{path.name[:100]}.{secrets.token_hex(8)}{TEMPORARY}"
    try:
        yield temporary
        if durable:
            with temporary.open("rb") as file:
                os.fsync(file.fileno())
        temporary.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
