"""What one core can add and multiply, measured; the yardstick of a flight.

Eight multiplications and eight additions on each number of a small array, which stays in the first cache. They depend
on each other within a number and not between numbers, so the compiler makes vectors as wide as it makes them for the
flight, and many of them are under way at once. Strict floating point as in the flight: a multiplication and an
addition are two instructions and never one fused one, which could do twice as much.
"""

import time

import numpy as np

from abhv_mc.kernel.jit import kernel

_NUMBERS = 128
_OPERATIONS = 16  # on each number in each sweep
_SWEEPS = 40_000


@kernel
def multiply_and_add(x, factor, addend, sweeps):  # type: ignore[no-untyped-def]
    """Eight times ``factor * x + addend`` in place on every number of ``x``, ``sweeps`` times over."""
    half = x.size // 2
    for _ in range(sweeps):
        for i in range(half):
            v, w = x[i], x[i + half]  # two vectors at a time: one after another, a core waits for the results
            for _ in range(8):
                v = v * factor + addend
                w = w * factor + addend
            x[i], x[i + half] = v, w


def measure_peak() -> float:
    """Additions and multiplications per second of one core now; some milliseconds of work."""
    x = np.linspace(0.0, 1.0, _NUMBERS)
    multiply_and_add(x, 0.5, 0.25, 1)  # compiles, or loads
    start = time.thread_time()
    multiply_and_add(x, 0.5, 0.25, _SWEEPS)
    return _NUMBERS * _OPERATIONS * _SWEEPS / (time.thread_time() - start)
