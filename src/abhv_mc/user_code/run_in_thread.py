"""Flights of a user law, which may never return: flown in a thread that can be left behind."""

import threading
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")


def run_in_thread(work: Callable[[], T], limit: float | None = None) -> T:
    """What ``work`` gives or raises; this thread hears of Ctrl-C meanwhile. Raises TimeoutError after ``limit`` s."""
    done: list[T] = []
    failed: list[BaseException] = []

    def run() -> None:
        try:
            done.append(work())
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(limit)
    if failed:
        raise failed[0]
    if not done:
        raise TimeoutError
    return done[0]
