"""Differences of failure shares and quantiles between two campaigns, with intervals.

Sources: Newcombe 1998, "Interval estimation for the difference between independent proportions",
method 10 (score intervals without continuity correction); Efron 1979 for the bootstrap.
"""

from math import sqrt

import numpy as np
from scipy.special import ndtri

from abhv_mc.array_types import Floats
from abhv_mc.statistics.estimates import SEED, Interval, sorted_quantile

_DRAWS = 4000
# minimum expected number of flights beyond a quantile for an interval of the difference
FEWEST_BEYOND = 5


def share_difference(
    failures_a: int, flights_a: int, failures_b: int, flights_b: int, confidence: float = 0.95
) -> Interval:
    """Return the failure share in `b` minus the share in `a`, with Newcombe's interval."""
    a, low_a, high_a = _wilson(failures_a, flights_a, confidence)
    b, low_b, high_b = _wilson(failures_b, flights_b, confidence)
    low = b - a - sqrt((b - low_b) ** 2 + (high_a - a) ** 2)
    return Interval(b - a, low, b - a + sqrt((high_b - b) ** 2 + (a - low_a) ** 2))


def _wilson(failures: int, flights: int, confidence: float) -> tuple[float, float, float]:
    """Return the share of failures, with Wilson's score interval."""
    z = float(ndtri(0.5 + 0.5 * confidence))
    share = failures / flights
    middle = (share + z * z / (2.0 * flights)) / (1.0 + z * z / flights)
    half = sqrt(share * (1.0 - share) / flights + z * z / (4.0 * flights**2))
    half *= z / (1.0 + z * z / flights)
    return share, max(0.0, middle - half), min(1.0, middle + half)


def quantile_difference(
    a: Floats, b: Floats, probability: float, confidence: float = 0.95
) -> Interval | None:
    """Return a quantile of the severities `b` minus the quantile of `a`, with its interval.

    Return None if too few flights lie beyond the quantile for a bootstrap, or if the quantile is
    infinite because of early terminations. The shares at the resampled quantiles are drawn from a
    beta distribution, which is equivalent to a bootstrap.
    """
    if min(a.size, b.size) * min(probability, 1.0 - probability) < FEWEST_BEYOND:
        return None
    generator, ascending = np.random.default_rng(SEED), (np.sort(a), np.sort(b))
    before, after = (sorted_quantile(values, probability) for values in ascending)
    if not np.isfinite([before, after]).all():
        return None
    drawn = []
    for values in ascending:
        rank = max(1, round(probability * values.size))
        shares = generator.beta(rank, values.size - rank + 1, _DRAWS)
        drawn.append(values[np.minimum((shares * values.size).astype(int), values.size - 1)])
    with np.errstate(invalid="ignore"):
        differences = drawn[1] - drawn[0]
    tail = 0.5 * (1.0 - confidence)
    differences = np.where(np.isnan(differences), np.inf, differences)
    low, high = np.quantile(differences, [tail, 1.0 - tail], method="nearest")
    return Interval(after - before, float(low), float(high))
