"""Quantiles with exact intervals, and the severities by which flights are ranked.

A failed flight counts as worse than every other flight: its severity is +infinity. Therefore a
quantile of the severity is finite only if more flights lie above the quantile than have failed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Indices, Mask
from abhv_mc.bounds import Bounds
from abhv_mc.statistics.binomial import clopper_pearson, quantile_upper_rank

Sense = Literal["high", "low", "size"]  # which values are bad: high, low or large in absolute value

SEED = 20140  # fixed seed of all resampling, so that the same flights give the same intervals
_SPREAD = (5.0, 95.0)  # percentiles whose difference is the spread
LEVELS = (0.5, 0.95, 0.9973)  # quantiles shown in tables


@dataclass(frozen=True)
class Interval:
    """Estimate with its confidence interval; a bound that does not exist is infinite."""

    value: float
    low: float
    high: float

    def in_sense(self, sense: Sense) -> "Interval":
        """Convert an interval of the severity to an interval of the metric."""
        return Interval(-self.value, -self.high, -self.low) if sense == "low" else self


def severity(values: Floats, sense: Sense, failed: Mask | None = None) -> Floats:
    """Return values with a sign such that larger is worse; failures and NaN are +infinity."""
    worse = {"high": 1.0, "low": -1.0, "size": 1.0}[sense] * (
        np.abs(values) if sense == "size" else values
    )
    bad = np.isnan(worse) if failed is None else np.isnan(worse) | failed
    return np.where(bad, np.inf, worse)


class Criterion(NamedTuple):
    """Ranking of flights by the signed excess of a metric over its limits."""

    metric: str
    bad: Sense
    limits: Bounds | None = None  # limits of the metric's requirement

    def excess(self, values: Floats) -> Floats:
        """Return the signed excess [flight] over the limits, in the metric's unit.

        Without limits the result is the severity. NaN gives +infinity.
        """
        if self.limits is None:
            return severity(values, self.bad)
        return severity(self.limits.worse(values) - self.limits.limit, "high")

    def scale(self, values: Floats) -> tuple[float, float]:
        """Return the origin and the unit in which an excess is expressed.

        With limits, the origin is 0 and the unit is the size of the limits or, if this is 0, the 5
        to 95 % span of `values` [flight]. Without limits, both are the median excess.
        """
        excess = self.excess(values)
        finite = excess[np.isfinite(excess)]
        start = 0.0 if self.limits or not finite.size else float(np.median(finite))
        return start, (self.limits.size if self.limits else abs(start)) or spread(values)


def spread(values: Floats) -> float:
    """Return the 5 to 95 % span of the finite values; 1 if there are none."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, _SPREAD) if finite.size else (0.0, 0.0)
    return float(high - low) or 1.0


def worst_first(lost_at: Floats, beyond: Floats) -> Indices:
    """Return the flight indices, worst first.

    Early terminations come first, sorted by their time `lost_at` [flight], which is infinite for
    completed flights. Completed flights follow, sorted by their excess `beyond` a limit [flight],
    largest first.
    """
    return np.lexsort((-beyond, lost_at))


def sorted_quantile(ascending: Floats, probability: float) -> float:
    """Return the linearly interpolated quantile of ascending values, which may be infinite."""
    position = (ascending.size - 1) * probability
    below = int(position)
    fraction = position - below
    if fraction == 0.0 or below + 1 >= ascending.size:
        return float(ascending[below])
    low, high = float(ascending[below]), float(ascending[below + 1])
    return high if low == high or np.isinf(high) else low + fraction * (high - low)


def quantile(values: Floats, probability: float, confidence: float = 0.95) -> Interval:
    """Return the `probability` quantile with its exact distribution-free interval.

    The two-sided interval is given by order statistics.
    """
    return quantiles(values, (probability,), confidence)[0]


def quantiles(
    values: Floats, probabilities: Sequence[float], confidence: float = 0.95
) -> list[Interval]:
    """Return several quantiles with their intervals, sorting the values once."""
    ascending, tail, intervals = np.sort(values), (1.0 - confidence) / 2.0, []
    for probability in probabilities:
        if not ascending.size:
            intervals.append(Interval(np.nan, -np.inf, np.inf))
            continue
        lower = quantile_upper_rank(
            ascending.size, 1.0 - probability, 1.0 - tail
        )  # Ranks of the lower bound are counted from the largest value.
        upper = quantile_upper_rank(ascending.size, probability, 1.0 - tail)
        ends = (
            -np.inf if lower is None else ascending[-lower],
            np.inf if upper is None else ascending[upper - 1],
        )
        intervals.append(Interval(sorted_quantile(ascending, probability), *map(float, ends)))
    return intervals


def pair_differences(a: Floats, b: Floats) -> Floats:
    """Return `a - b` [pair]; 0 if both are the same infinity, as for early terminations."""
    with np.errstate(invalid="ignore"):
        return np.where(np.isinf(a) & (a == b), 0.0, a - b)


def looks(flights: int, first: int = 20) -> list[int]:
    """Return 12 geometrically spaced numbers of flights, with a quarter and half of the flights."""
    if flights <= first:
        return [flights]
    shares = [n for n in (flights // 4, flights // 2) if n > first]
    counts = np.round(np.geomspace(first, flights, 12)).astype(np.int64)
    return np.union1d(counts, shares).astype(np.int64).tolist()


def quantile_traces(values: Floats, counts: Sequence[int]) -> list[tuple[Interval, ...]]:
    """Return, for each of LEVELS, quantiles of the first n values for n in `counts`."""
    return list(zip(*(quantiles(values[:n], LEVELS) for n in counts), strict=True))


def failure_trace(failed: Mask, counts: Sequence[int]) -> list[Interval]:
    """Return the shares of failures among the first n flights for n in `counts`."""
    totals = np.cumsum(failed)[np.array(counts) - 1].tolist()
    return [Interval(k / n, *clopper_pearson(k, n)) for k, n in zip(totals, counts, strict=True)]
