"""Acceptance and rejection numbers of a sequential test, and the looks that suit them.

A count of failures settles where a weighted mean of likelihood ratios against the allowed failure rate reaches a
threshold (mixture sequential probability ratio test, Robbins 1970). Most of the weight of a PASS lies at a fifth of
the allowed rate, so that a good system costs little more than Wald's test for that rate; the rest keeps systems
closer to the requirement from waiting for ever.
"""

from collections.abc import Callable, Sequence
from math import exp, log

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from abhv_mc.statistics.estimates import Floats

Counts = NDArray[np.int64]

_GOOD, _GOOD_WEIGHTS = (0.2, 0.5, 0.75, 0.92), (0.955, 0.025, 0.01, 0.01)  # failure rates over the allowed one
_BAD, _BAD_WEIGHTS = (5.0, 2.0, 1.33, 1.08), (0.5, 0.25, 0.15, 0.1)  # odds of failure over the allowed ones
_RATIO = 1.1  # between looks, once a look at every acceptance number would be closer
_EARLY = (4, 2)  # looks at these parts of the first that can pass, for systems that fail most flights


class Mixture:
    """Mean likelihood ratio of other failure rates against the allowed one."""

    def __init__(self, allowed: float, rates: Floats, weights: Sequence[float]) -> None:
        self._log_weights = np.log(weights)
        self._failure = np.log(rates / allowed)
        self._success = np.log1p(-rates) - np.log1p(-allowed)

    @classmethod
    def good(cls, allowed: float) -> "Mixture":
        """For a PASS."""
        return cls(allowed, allowed * np.array(_GOOD), _GOOD_WEIGHTS)

    @classmethod
    def bad(cls, allowed: float) -> "Mixture":
        """For a FAIL."""
        odds = np.array(_BAD) * allowed / (1.0 - allowed)
        return cls(allowed, odds / (1.0 + odds), _BAD_WEIGHTS)

    def log_ratio(self, flights: Counts, failures: Counts) -> Floats:
        """Logarithm of the mean ratio after `failures` in `flights`, of any shape."""
        n, k = np.asarray(flights)[..., None], np.asarray(failures)[..., None]
        return np.asarray(
            logsumexp(self._log_weights + k * self._failure + (n - k) * self._success, axis=-1), dtype=np.float64
        )

    def reaches(self, flights: int, failures: int, threshold: float) -> bool:
        """Whether one count reaches a threshold."""
        terms = zip(self._log_weights.tolist(), self._failure.tolist(), self._success.tolist(), strict=True)
        logarithms = [weight + failures * bad + (flights - failures) * good for weight, bad, good in terms]
        most = max(logarithms)
        return most + log(sum(exp(one - most) for one in logarithms)) >= threshold

    def first_flights(self, failures: int, threshold: float, most: int) -> int | None:
        """Fewest flights, up to `most`, with which so many failures reach the threshold; None where none do."""
        if failures > most or not self.reaches(most, failures, threshold):
            return None
        return _first(failures, most, lambda flights: self.reaches(flights, failures, threshold))


def _first(low: int, high: int, holds: Callable[[int], bool]) -> int:
    """Smallest integer of low..high where `holds`, which holds at `high` and from the first on."""
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return low


class Boundary:
    """Acceptance (`low`) or rejection numbers of looks for any threshold on a mean likelihood ratio."""

    def __init__(self, mixture: Mixture, looks: Counts, low: bool) -> None:
        self._mixture, self._looks, self._low = mixture, looks, low

    def at(self, threshold: float) -> Counts:
        """The largest count [look] that passes, -1 for none; or the smallest that fails, flights + 1 for none."""
        inside, outside = np.full_like(self._looks, -1), self._looks + 1
        if not self._low:
            inside, outside = outside, inside
        while np.any(np.abs(outside - inside) > 1):
            middle = (inside + outside) // 2
            reached = self._mixture.log_ratio(self._looks, middle) >= threshold
            apart = np.abs(outside - inside) > 1
            inside = np.where(apart & reached, middle, inside)
            outside = np.where(apart & ~reached, middle, outside)
        return inside


def looks_at(mixture: Mixture, threshold: float, most: int) -> tuple[int, ...]:
    """A look wherever one more failure would still pass, thinned out to a ratio, a few before, and one at `most`."""
    looks: list[int] = []
    failures = 0
    while True:
        found = mixture.first_flights(failures, threshold, most)
        if found is None or found * (1.0 + _RATIO) / 2.0 > most:  # no look just before the last
            break
        looks.append(found)
        # The first number that does not come sooner than the ratio.
        near = int(np.ceil(found * _RATIO)) - 1
        failures = _first(failures + 1, near + 1, lambda count, near=near: not mixture.reaches(near, count, threshold))  # type: ignore[misc]
    early = sorted({looks[0] // part for part in _EARLY} - {0}) if looks else []
    return (*early, *looks, most)
