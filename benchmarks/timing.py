"""Ratios of times that hold on a busy machine: the two sides take turns, and the median of the turns counts."""

import time
from collections.abc import Callable
from statistics import median
from typing import Any


def measure_ratio(slow: Callable[[], Any], fast: Callable[[], Any], pairs: int = 9) -> float:
    """Processor time of ``slow`` over that of ``fast``, median over the pairs; both are called once before."""
    slow(), fast()
    return median(measure_time(slow) / measure_time(fast) for _ in range(pairs))


def measure_time(call: Callable[[], Any]) -> float:
    """Seconds of this thread's processor time."""
    start = time.thread_time()
    call()
    return time.thread_time() - start
