"""Differences between two controllers' quantiles on the same flights, with intervals.

The number of flights below a quantile is binomial for any distribution of the values, so order
statistics bound the quantile; a bound beyond the first or last value is infinite. The counts of two
controllers are correlated if the same flights lie beyond both quantiles. Therefore the counts are
drawn jointly, as normal scores with the correlation of the exceedances of the two quantiles.
"""

from functools import lru_cache

import numpy as np
from scipy.special import bdtr, bdtrik, ndtr, ndtri

from abhv_mc.array_types import Floats, Indices
from abhv_mc.statistics.estimates import SEED, Interval, pair_differences, sorted_quantile

_FEWEST_DRAWS, _MOST_DRAWS = 2_000, 60_000
_PER_TAIL = 50  # minimum number of draws beyond each bound of an interval
_CAUTION = 1.0  # number of flights subtracted from the observed overlap of two tails


@lru_cache(maxsize=16)
def _scores(draws: int) -> tuple[Floats, Floats]:
    """Return two independent sets of standard normal scores from a fixed seed."""
    draw = np.random.default_rng(SEED)
    return draw.standard_normal(draws), draw.standard_normal(draws)


@lru_cache(maxsize=64)
def _places(flights: int, probability: float) -> tuple[int, Floats]:
    """Return the lowest relevant count of flights below the quantile, and all normal scores."""
    low, high = (int(np.ceil(bdtrik(tail, flights, probability))) for tail in (1e-9, 1.0 - 1e-9))
    return low, ndtri(bdtr(np.arange(low, high + 1), flights, probability))


def _counts(scores: Floats, flights: int, probability: float) -> Indices:
    """Convert normal scores to counts of flights below the quantile."""
    first, thresholds = _places(flights, probability)
    return np.minimum(first + np.searchsorted(thresholds, scores), flights)


@lru_cache(maxsize=256)  # Most comparisons of a campaign have one of a few correlations.
def _drawn_counts(
    flights: int, probability: float, draws: int, correlation: float
) -> tuple[Indices, Indices, Indices]:
    """Return the different pairs of correlated counts, and how often each pair is drawn."""
    first, second = _scores(draws)
    scores = correlation * first + np.sqrt(1.0 - correlation**2) * second
    a, b = _counts(first, flights, probability), _counts(scores, flights, probability)
    low, width = min(a.min(), b.min()), int(b.max()) + 1
    drawn = np.bincount((a - low) * width + b)
    pairs = np.flatnonzero(drawn)
    return pairs // width + low, pairs % width, drawn[pairs]


def _together(a: Floats, b: Floats, high_a: float, high_b: float, probability: float) -> float:
    """Return a conservative correlation of the exceedances of the quantiles of `a` and `b`."""
    beyond_a, beyond_b = a > high_a, b > high_b
    if probability < 0.5:
        beyond_a, beyond_b = a < high_a, b < high_b
    share = min(probability, 1.0 - probability)
    both = max(float(np.sum(beyond_a & beyond_b)) - _CAUTION, 0.0) / a.size
    return float(np.clip((both - share**2) / (share * (1.0 - share)), -0.999, 0.999))


def flights_to_bound(probability: float) -> int:
    """Return the minimum number of flights that bounds a difference of two quantiles.

    The number is valid if no flight terminates early. The bound on the worse side is a value of the
    first controller above its quantile; there is no such value if all flights lie below the
    quantile. The returned number limits the chance of this event to one tail of the confidence
    interval.
    """
    tail, draws = _draws(0.95)
    # The bound is infinite if all flights lie below the quantile for more than `rank` scores.
    rank = int(tail * draws)
    score = float(np.partition(_scores(draws)[0], draws - 1 - rank)[draws - 1 - rank])
    extreme = max(probability, 1.0 - probability)
    flights = max(1, int(np.log(1.0 - ndtr(score)) / np.log(extreme)))
    while _counts(np.array([score]), flights, extreme)[0] >= flights:
        flights += 1
    return flights


def _draws(confidence: float) -> tuple[float, int]:
    """Return the probability of one tail and the number of draws that resolve it."""
    tail = (1.0 - confidence) / 2.0
    return tail, int(np.clip(_PER_TAIL / tail, _FEWEST_DRAWS, _MOST_DRAWS))


def quantile_difference(
    a: Floats, b: Floats, probability: float, confidence: float = 0.95
) -> Interval:
    """Return the `probability` quantile of `a` minus the quantile of `b`, with its interval.

    `a` and `b` have shape [pair]; +infinity marks an early termination. If both quantiles are
    infinite, the value is NaN.
    """
    return quantile_differences(a, b, (probability,), confidence)[0]


def quantile_differences(
    a: Floats, b: Floats, probabilities: tuple[float, ...], confidence: float = 0.95
) -> list[Interval]:
    """Return the differences between several quantiles; see :func:`quantile_difference`.

    Raise ValueError if `a` and `b` are empty or differ in shape.
    """
    if a.size == 0 or a.shape != b.shape:
        raise ValueError(
            f"paired samples must be nonempty and have equal sizes, found {a.size} and {b.size}"
        )
    sorted_a, sorted_b = np.sort(a), np.sort(b)
    # Bounds at ranks before the first or after the last value are infinite.
    padded_a, padded_b = (
        np.concatenate([[-np.inf], values, [np.inf]]) for values in (sorted_a, sorted_b)
    )
    tail, draws = _draws(confidence)
    intervals = []
    for probability in probabilities:
        high_a = sorted_quantile(sorted_a, probability)
        high_b = sorted_quantile(sorted_b, probability)
        if np.isinf(high_a) and np.isinf(high_b):
            intervals.append(Interval(np.nan, np.nan, np.nan))
            continue
        shared = _together(a, b, high_a, high_b, probability)
        below_a, below_b, drawn = _drawn_counts(a.size, probability, draws, shared)
        low = pair_differences(padded_a[below_a], padded_b[below_b + 1])
        high = pair_differences(padded_a[below_a + 1], padded_b[below_b])
        rank = int(tail * draws)
        ends = _drawn_value(low, drawn, rank), _drawn_value(high, drawn, draws - 1 - rank)
        intervals.append(Interval(high_a - high_b, *ends))
    return intervals


def _drawn_value(values: Floats, drawn: Indices, rank: int) -> float:
    """Return the value with a rank among values that are repeated ``drawn`` times."""
    order = np.argsort(values)
    index = np.searchsorted(np.cumsum(drawn[order]), rank, side="right")
    return float(values[order[index]])
