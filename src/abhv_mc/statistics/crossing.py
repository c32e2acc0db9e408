"""Exact chances of a sequential test: how likely the failures settle it at each look.

The number of failures that have settled nothing so far is followed from look to look, by the binomial law of the
flights in between (Jennison & Turnbull, "Group Sequential Methods", 2000, chapter 12).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import gammaln, xlog1py, xlogy

from abhv_mc.statistics.estimates import Floats

_NEGLIGIBLE = 1e-18  # probability of a count of failures that is followed no further
_DIRECT = 200_000  # products up to which a plain convolution is quicker than Fourier's


@dataclass(frozen=True)
class Crossing:
    """What happens at each look [look], for one failure rate."""

    passed: Floats  # chance to pass there, and not before
    failed: Floats  # chance to fail there, and not before
    reached: Floats  # chance that the look is reached

    def expected(self, looks: Sequence[int]) -> float:
        """Expected number of flights."""
        return float(np.sum(self.reached * np.diff(looks, prepend=0)))


@lru_cache(maxsize=256)
def binomial_window(flights: int, rate: float) -> tuple[int, Floats]:
    """First count and probabilities of the counts of failures that matter among so many flights."""
    mean, spread = flights * rate, np.sqrt(flights * rate * (1.0 - rate))
    # Beyond ten standard deviations, and thirty counts for the long tails of rare failures, there is nothing left.
    low, high = max(0, int(mean - 10.0 * spread - 30.0)), min(flights, int(mean + 10.0 * spread + 30.0))
    count = np.arange(low, high + 1)
    logarithm = gammaln(flights + 1.0) - gammaln(count + 1.0) - gammaln(flights - count + 1.0)
    return low, np.exp(logarithm + xlogy(count, rate) + xlog1py(flights - count, -rate))


def _convolve_large(a: Floats, b: Floats) -> Floats:
    from scipy.signal import fftconvolve  # half a second of imports that most commands do not need

    found: Floats = np.maximum(fftconvolve(a, b), 0.0)
    return found


def cross(looks: Sequence[int], accept: Sequence[int], reject: Sequence[int], rate: float) -> Crossing:
    """Chances to pass (failures at most `accept`) and to fail (at least `reject`) at each look, first come first."""
    passed, failed, reached = np.zeros(len(looks)), np.zeros(len(looks)), np.zeros(len(looks))
    first, inside, before = 0, np.ones(1), 0
    for i, (look, low, high) in enumerate(zip(looks, accept, reject, strict=True)):
        if not inside.size:
            break
        reached[i] = inside.sum()
        start, more = binomial_window(look - before, rate)
        direct = inside.size * more.size <= _DIRECT
        inside = np.convolve(inside, more) if direct else _convolve_large(inside, more)
        first, before = first + start, look
        below = int(np.clip(low + 1 - first, 0, inside.size))
        above = int(np.clip(high - first, below, inside.size))
        passed[i], failed[i] = inside[:below].sum(), inside[above:].sum()
        first, inside = first + below, inside[below:above]
        counted = np.flatnonzero(inside > _NEGLIGIBLE)
        if not counted.size:
            inside = inside[:0]
        else:
            first, inside = first + int(counted[0]), inside[counted[0] : counted[-1] + 1]
    return Crossing(passed, failed, reached)
