"""How a file gets to its place: whole or not at all."""

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path

ASIDE = ".aside"  # ending of a file that is being written


@contextlib.contextmanager
def atomic_write(path: Path, durable: bool = False) -> Iterator[Path]:
    """A path beside ``path`` to write to; it is renamed at the end, or deleted where the writing failed.

    Writers of the same file do not disturb each other: the last to end wins. The folder is made where it is missing;
    ``durable`` waits until the disk has the content. Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    # The dot hides it from readers of the folder.
    aside = path.with_name(f".{path.name}.{os.getpid()}-{threading.get_ident()}{ASIDE}")
    try:
        yield aside
        if durable:
            with aside.open("rb") as file:
                os.fsync(file.fileno())
        aside.replace(path)
    except BaseException:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)
        raise
