"""Importance weighting: estimates for distributions other than those simulated.

Each flight is weighted by the ratio of the densities, divided by the sum of all ratios (Owen,
"Monte Carlo theory, methods and examples", 2013, chapter 9). Intervals are computed as for
unweighted flights, with the effective number of flights (Kish's number, or fewer if the weights of
the counted flights vary more); the bound on the bad side uses the effective number of the bad
flights.
"""

from bisect import bisect_left
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq
from scipy.special import betainc, betaincinv

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.estimates import Interval

# gap as a multiple of 1/flights; 95 % of the exponentially distributed gaps are narrower
_GAP = 3.0
_UP = 1.0 + 1e-9  # largest ratio of two shares that counts as a rounding error


def effective_size(weights: Floats) -> float:
    """Return Kish's effective number of flights, (sum w)^2 / sum w^2 (Kish 1965)."""
    squares = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / squares if squares > 0.0 else 0.0


class Unseen(NamedTuple):
    """Probability, under the new distributions, of values that no flight represents."""

    # largest probability, over the parameters, of a value that no flight represents
    single: float
    # probability that at least one parameter has a value that no flight represents, except near the
    # outermost flights
    joint: float


def unseen_of_range(
    beyond: tuple[float, float], weights: tuple[float, float], flights: int
) -> tuple[float, float]:
    """Return the probability `beyond` the extreme flights, and its unrepresented part.

    `beyond` contains the probabilities below the lowest and above the highest flight of one
    parameter; `weights` are the density ratios at these two flights. Each flight represents an
    equal share of the simulated distribution, and random gaps between flights are a few shares
    wide. Therefore the range beyond an extreme flight is unseen only if it is wider than such a
    gap.
    """
    excess = sum(
        max(probability - _GAP * weight / flights, 0.0)
        for probability, weight in zip(beyond, weights, strict=True)
    )
    return float(sum(beyond)), float(excess)


def unseen_of_values(values: Floats, probabilities: Floats, flown: Floats) -> tuple[float, float]:
    """Return, as two equal numbers, the probability of discrete `values` that no flight has."""
    missing = float(np.sum(probabilities[~np.isin(values, flown)]))
    return missing, missing


def join_unseen(pairs: Sequence[tuple[float, float]]) -> Unseen:
    """Combine the unseen probabilities of all parameters."""
    return Unseen(
        max((pair[0] for pair in pairs), default=0.0), min(sum(pair[1] for pair in pairs), 1.0)
    )


def _effective_at(flags: Mask, share: float, weights: Floats) -> float:
    """Return the effective number of flights for estimating a share.

    The number follows from the ratio of the binomial variance to the weighted variance.
    """
    spread = float(np.sum((weights * (flags - share)) ** 2))
    if share <= 0.0 or share >= 1.0 or spread == 0.0:
        return effective_size(weights)
    return min(
        share * (1.0 - share) * float(np.sum(weights)) ** 2 / spread, effective_size(weights)
    )


def _high_end(counted: Floats, heaviest: float, tail: float) -> float:
    """Return the upper Clopper-Pearson bound from the effective number of counted flights.

    `counted` contains the normalized weights [flight] of the counted flights. One more flight with
    the weight `heaviest` is counted (Fay & Feuer 1997), because heavy flights are rarely sampled.
    """
    total, squares = float(counted.sum()) + heaviest, float(np.sum(counted**2)) + heaviest**2
    # effective number of counted flights, and the share represented by one of these flights
    events, mean_share = total**2 / squares, squares / total
    failures = 1.0 / mean_share - events + 1.0
    return 1.0 if failures <= 0.0 else float(betaincinv(events, failures, 1.0 - tail))


def weighted_share(flags: Mask, weights: Floats, unseen: float = 0.0) -> Interval:
    """Return the weighted share of flights for which `flags` is true, with its 95 % interval.

    The upper bound includes `unseen`, the probability that no flight represents.
    """
    tail, parts = (1.0 - 0.95) / 2.0, weights / weights.sum()
    counted = parts[flags]
    share = float(counted.sum())
    number = _effective_at(flags, share, weights)
    low = float(betaincinv(share * number, (1.0 - share) * number + 1.0, tail)) if share else 0.0
    high = _high_end(counted, float((counted if counted.size else parts).max()), tail)
    return Interval(share, low, min(high + unseen, 1.0))


def weighted_quantile(
    values: Floats,
    weights: Floats,
    probability: float,
    unseen: float = 0.0,
) -> Interval:
    """Return the weighted `probability` quantile of `values` [flight], with its 95 % interval.

    Equal weights give numpy's linear quantile. `unseen` is the probability of values that no flight
    represents; these values may be worse than all simulated values.
    """
    has_weight = weights > 0.0
    order = np.argsort(values[has_weight], kind="stable")
    ascending, mass = values[has_weight][order], weights[has_weight][order]
    parts = mass / mass.sum()
    cumulative = np.cumsum(parts)  # cumulative share of the flights at or below each value
    value = _between(ascending, cumulative - parts, probability)
    n = _effective_at(ascending <= value, probability, mass)
    tail = (1.0 - 0.95) / 2.0
    low = -np.inf
    # As with order statistics, the quantile has no bound if there are too few flights.
    if (1.0 - probability) ** n <= tail:
        below = 1.0  # If all flights probably lie below the quantile, use the largest value.
        if 1.0 - probability**n > tail:
            below = (
                brentq(lambda rank: betainc(n - rank + 1.0, rank, 1.0 - probability) - tail, 1.0, n)
                / n
            )
        low = float(
            ascending[max(int(np.searchsorted(cumulative, below * _UP, side="right")) - 1, 0)]
        )
    return Interval(value, low, _high_quantile(ascending, parts, 1.0 - probability - unseen, tail))


def _high_quantile(ascending: Floats, parts: Floats, allowed: float, tail: float) -> float:
    """Return the smallest value exceeded by at most the share `allowed`, or infinity."""

    def enough(first: int) -> bool:
        beyond = parts[first:]
        return (
            _high_end(beyond, float((beyond if beyond.size else parts).max()), tail)
            <= allowed * _UP
        )

    most = parts.size  # largest number of flights at or below the quantile
    if not enough(most):
        return np.inf
    count = bisect_left(range(most), True, key=enough)
    return float(ascending[max(count - 1, 0)])


def _between(ascending: Floats, start: Floats, probability: float) -> float:
    """Return the quantile, interpolated linearly over shares rescaled to 0..1."""
    if ascending.size == 1 or start[-1] == 0.0:
        return float(ascending[-1])
    rescaled = start / start[-1]
    above = int(np.clip(np.searchsorted(rescaled, probability, side="left"), 1, ascending.size - 1))
    low, high = float(ascending[above - 1]), float(ascending[above])
    fraction = (probability - rescaled[above - 1]) / (rescaled[above] - rescaled[above - 1])
    if low == high or fraction <= 0.0:
        return low
    return high if np.isinf(high) or fraction >= 1.0 else low + float(fraction) * (high - low)
