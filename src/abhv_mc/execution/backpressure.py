"""Does work on threads, limits what is done ahead of the disk, and ends what nobody waits for any more."""

import threading
import warnings
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

T = TypeVar("T")


def work_ahead(
    workers: int, work: Callable[..., T], calls: Iterable[tuple[Any, ...]]
) -> Generator[T, None, None]:
    """What ``work`` gives for each of ``calls``, its arguments, as soon as it is finished: in any order.

    At most two results for each worker are being made or wait to be taken. Without this limit, workers that are
    faster than the disk would fill the memory with finished blocks. Close it: then every waiting worker ends.
    """
    from joblib import Parallel, delayed

    room = threading.Semaphore(2 * workers)
    closed = threading.Event()

    def call(arguments: tuple[Any, ...]) -> T:
        room.acquire()
        if closed.is_set():
            room.release()  # so that the next one ends, too
            raise RuntimeError("nobody waits for this block")
        return work(*arguments)

    pool = Parallel(
        n_jobs=workers,
        backend="threading",
        return_as="generator_unordered",
        pre_dispatch="2*n_jobs",
    )
    results = pool(delayed(call)(arguments) for arguments in calls)
    try:
        for result in results:
            yield result
            room.release()
    finally:
        closed.set()
        room.release()
        with warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", UserWarning
            )  # joblib's, that not all was used: an interrupt means that
            results.close()
