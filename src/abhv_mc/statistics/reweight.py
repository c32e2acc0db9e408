"""Estimates from flights that were drawn from other distributions than those asked about: importance weighting.

Each flight counts by the ratio of the densities; ratios are normalized by their sum (Owen, "Monte Carlo theory,
methods and examples", 2013, chapter 9). Intervals are those of counted flights with the number of flights replaced by
the effective one (Kish's, or less where the weights of what is estimated vary more than the rest); the end on the bad
side by the effective number of the flights that are bad.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import betainc, betaincinv

from abhv_mc.array_types import Floats
from abhv_mc.statistics.estimates import Interval

_GAP = 3.0  # parts of 1/flights: 19 in 20 gaps are narrower, their law being exponential
_UP = 1.0 + 1e-9  # shares that are equal but for rounding


def effective_size(weights: Floats) -> float:
    """Number of equally weighted flights that say as much: (sum w)^2 / sum w^2 (Kish 1965)."""
    squares = float(np.sum(weights**2))
    return float(np.sum(weights)) ** 2 / squares if squares > 0.0 else 0.0


@dataclass(frozen=True)
class Unseen:
    """Probability, under changed laws, of values that no flight stands for."""

    single: float  # the largest of any one parameter, beyond its outermost flights or at values that none had
    joint: float  # of any parameter, but for what the outermost flights stand for themselves


def unseen_of_range(
    beyond: tuple[float, float], weights: tuple[float, float], flights: int
) -> tuple[float, float]:
    """Probability `beyond` the lowest and highest flight of one parameter, and what of it no flight stands for.

    `weights` are the ratios of the laws at those two. Each flight stands for its part of the law that was flown, and
    chance leaves gaps of a few such parts between flights; what lies beyond the outermost ones is no more unseen than
    such a gap, as long as it is no wider.
    """
    excess = sum(
        max(part - _GAP * weight / flights, 0.0)
        for part, weight in zip(beyond, weights, strict=True)
    )
    return float(sum(beyond)), float(excess)


def unseen_of_values(values: Floats, probabilities: Floats, flown: Floats) -> tuple[float, float]:
    """Probability of discrete `values` that none of the `flown` ones is: all of it is unseen."""
    missing = float(np.sum(probabilities[~np.isin(values, flown)]))
    return missing, missing


def join_unseen(parts: Sequence[tuple[float, float]]) -> Unseen:
    """All parameters together."""
    return Unseen(
        max((part[0] for part in parts), default=0.0), min(sum(part[1] for part in parts), 1.0)
    )


def _effective_at(flags: NDArray[np.bool_], share: float, weights: Floats) -> float:
    """Effective number of flights for a share: the binomial's variance over the one that the weights give."""
    spread = float(np.sum((weights * (flags - share)) ** 2))
    if share <= 0.0 or share >= 1.0 or spread == 0.0:
        return effective_size(weights)
    return min(
        share * (1.0 - share) * float(np.sum(weights)) ** 2 / spread, effective_size(weights)
    )


def _low_end(share: float, flights: float, tail: float) -> float:
    """Clopper-Pearson's lower end on a share of an effective number of flights, whole or not."""
    inside, outside = share * flights, (1.0 - share) * flights
    return 0.0 if inside <= 0.0 else float(betaincinv(inside, outside + 1.0, tail))


def _high_end(counted: Floats, heaviest: float, tail: float) -> float:
    """Clopper-Pearson's upper end from the effective number of the flights that count, not of all.

    One more flight may count, as heavy as the `heaviest` that does (Fay & Feuer 1997): `counted` are the parts [flight]
    of all weight that those which count have. Chance leaves out heavy flights more often than not.
    """
    total, squares = float(counted.sum()) + heaviest, float(np.sum(counted**2)) + heaviest**2
    events, each = (
        total**2 / squares,
        squares / total,
    )  # effective number, and the share that each stands for
    rest = 1.0 / each - events + 1.0
    return 1.0 if rest <= 0.0 else float(betaincinv(events, rest, 1.0 - tail))


def weighted_share(
    flags: NDArray[np.bool_], weights: Floats, unseen: float = 0.0, confidence: float = 0.95
) -> Interval:
    """Share of the flights with `flags`; `unseen` is the probability that the flights do not reach, all counted in."""
    tail, parts = (1.0 - confidence) / 2.0, weights / weights.sum()
    counted = parts[flags]
    share = float(counted.sum())
    low = _low_end(share, _effective_at(flags, share, weights), tail)
    high = _high_end(counted, float((counted if counted.size else parts).max()), tail)
    return Interval(share, low, min(high + unseen, 1.0))


def weighted_quantile(
    values: Floats,
    weights: Floats,
    probability: float,
    unseen: float = 0.0,
    confidence: float = 0.95,
) -> Interval:
    """The `probability` quantile of `values` [flight] and its interval; equal weights give numpy's `linear` quantile.

    `unseen` is the probability that the flights do not reach; its values may be worse than all.
    """
    kept = weights > 0.0
    order = np.argsort(values[kept], kind="stable")
    ascending, mass = values[kept][order], weights[kept][order]
    parts = mass / mass.sum()
    reached = np.cumsum(parts)  # share at or below each value
    value = _between(ascending, reached - parts, probability)
    n = _effective_at(ascending <= value, probability, mass)
    tail = (1.0 - confidence) / 2.0
    low = -np.inf
    # As with order statistics, no value bounds a quantile that so few flights may well not reach.
    if (1.0 - probability) ** n <= tail:
        below = 1.0  # where so few flights lie below the quantile, all of them
        if 1.0 - probability**n > tail:
            below = (
                brentq(lambda rank: betainc(n - rank + 1.0, rank, 1.0 - probability) - tail, 1.0, n)
                / n
            )
        low = float(ascending[max(int(np.searchsorted(reached, below * _UP, side="right")) - 1, 0)])
    return Interval(value, low, _high_quantile(ascending, parts, 1.0 - probability - unseen, tail))


def _high_quantile(ascending: Floats, parts: Floats, allowed: float, tail: float) -> float:
    """The smallest value beyond which at most a share `allowed` lies; infinite where none is."""

    def enough(first: int) -> bool:
        beyond = parts[first:]
        return (
            _high_end(beyond, float((beyond if beyond.size else parts).max()), tail)
            <= allowed * _UP
        )

    low, high = 0, parts.size  # number of flights at or below
    if not enough(high):
        return np.inf
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if enough(middle) else (middle + 1, high)
    return float(ascending[max(low - 1, 0)])


def _between(ascending: Floats, start: Floats, probability: float) -> float:
    """Linear between values whose places are the shares below them, stretched to 0..1."""
    if ascending.size == 1 or start[-1] == 0.0:
        return float(ascending[-1])
    place = start / start[-1]
    above = int(np.clip(np.searchsorted(place, probability, side="left"), 1, ascending.size - 1))
    low, high = float(ascending[above - 1]), float(ascending[above])
    part = (probability - place[above - 1]) / (place[above] - place[above - 1])
    if low == high or part <= 0.0:
        return low
    return high if np.isinf(high) or part >= 1.0 else low + float(part) * (high - low)
