"""Function calls on threads, with a limit on the number of results that wait for the disk."""

import threading
import warnings
from collections.abc import Callable, Generator, Iterable
from typing import Any, TypeVar

T = TypeVar("T")


def work_ahead(
    workers: int, work: Callable[..., T], calls: Iterable[tuple[Any, ...]]
) -> Generator[T, None, None]:
    """Yield the result of ``work`` for each of ``calls``, in order of completion.

    At any time, at most two results per worker are in progress or finished but unused. Without
    this limit, workers that are faster than the disk would fill the memory with finished blocks.
    Closing the generator ends all waiting workers.
    """
    from joblib import Parallel, delayed

    slots = threading.Semaphore(2 * workers)
    closed = threading.Event()

    def call(arguments: tuple[Any, ...]) -> T:
        slots.acquire()
        if closed.is_set():
            slots.release()  # Without the slot, the next thread cannot end.
            raise RuntimeError("the results are no longer needed")
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
            slots.release()
    finally:
        closed.set()
        slots.release()
        with warnings.catch_warnings():
            # An interrupt leaves unused results, about which joblib warns.
            warnings.simplefilter("ignore", UserWarning)
            results.close()
