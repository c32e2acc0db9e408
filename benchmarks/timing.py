"""Ratios of times that are valid on a busy machine, because both sides alternate."""

import time
from collections.abc import Callable
from statistics import median
from typing import Any


def measure_ratio(slow: Callable[[], Any], fast: Callable[[], Any], pairs: int = 9) -> float:
    """Return the processor time of ``slow`` over that of ``fast``, as a median over pairs.

    Both are called once before.
    """
    slow(), fast()
    return median(measure_time(slow) / measure_time(fast) for _ in range(pairs))


def measure_time(call: Callable[[], Any]) -> float:
    """Return the processor time of a call in this thread, s."""
    start = time.thread_time()
    call()
    return time.thread_time() - start
