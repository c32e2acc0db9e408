"""Limits what is flown ahead of the disk, and ends what nobody waits for any more."""

import contextlib
import threading
import warnings
from collections.abc import Callable, Generator, Iterator
from typing import Any, TypeVar

T = TypeVar("T")


class Backpressure:
    """Limits the blocks that are being flown or wait to be written.

    Without it, workers that are faster than the disk would fill the memory with finished blocks.
    """

    def __init__(self, number: int) -> None:
        self._free = threading.Semaphore(number)
        self._closed = False

    def call(self, work: Callable[..., T], *arguments: Any) -> T:
        """What ``work`` gives once there is room. Raises RuntimeError after :meth:`close`, when nobody listens."""
        self._free.acquire()
        if self._closed:
            self.free()  # so that the next one ends, too
            raise RuntimeError("nobody waits for this block")
        return work(*arguments)

    def free(self) -> None:
        """Make room: a block was written."""
        self._free.release()

    def close(self) -> None:
        """Let every waiting worker end."""
        self._closed = True
        self.free()


@contextlib.contextmanager
def closing_quietly(results: Generator[Any, None, None]) -> Iterator[None]:
    """Stop the workers at the end; joblib's warning that not all was used is what an interrupt means."""
    try:
        yield
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            results.close()
