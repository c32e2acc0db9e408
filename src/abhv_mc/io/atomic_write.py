"""How a file gets to its place: whole or not at all."""

import contextlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path

TEMPORARY = ".temporary"  # ending of a file that is being written


@contextlib.contextmanager
def atomic_write(path: Path, durable: bool = False) -> Iterator[Path]:
    """A path beside ``path`` to write to; it is renamed at the end, or deleted where the writing failed.

    It is absolute: pyarrow takes a relative one with a colon for an address. Writers of the same file do not disturb
    each other: the last to end wins. The folder is made where it is missing; ``durable`` waits until the disk has the
    content. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The dot hides it from readers of the folder.
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
