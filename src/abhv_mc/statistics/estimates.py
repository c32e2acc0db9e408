"""Quantiles with exact intervals, the sense in which a metric is bad, and by what flights are ranked.

A flight that failed counts as worse than every flight that did not: its value is replaced by +infinity in the
sense of the metric, so a quantile is finite only as long as fewer flights failed than lie beyond it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask
from abhv_mc.bounds import Bounds
from abhv_mc.statistics.binomial import clopper_pearson, quantile_upper_rank

Sense = Literal[
    "high", "low", "size"
]  # what is bad: large values, small values, large absolute values

SEED = 20140  # of all resampling: the same flights give the same interval
_SPREAD = (5.0, 95.0)  # percentiles of all flights
LEVELS = (0.5, 0.95, 0.9973)  # the quantiles that tables show


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence interval; an end that the flights do not bound is infinite."""

    value: float
    low: float
    high: float

    def in_sense(self, sense: Sense) -> "Interval":
        """The interval of a severity as one of the metric itself: small values are bad in the sense "low"."""
        return Interval(-self.value, -self.high, -self.low) if sense == "low" else self


def severity(values: Floats, sense: Sense, failed: Mask | None = None) -> Floats:
    """Values turned so that larger is worse; those of failed flights (and not-a-number) become +infinity."""
    worse = {"high": 1.0, "low": -1.0, "size": 1.0}[sense] * (
        np.abs(values) if sense == "size" else values
    )
    bad = np.isnan(worse) if failed is None else np.isnan(worse) | failed
    return np.where(bad, np.inf, worse)


class Criterion(NamedTuple):
    """By what flights are ranked: a metric's distance beyond a limit, on the side that is bad."""

    metric: str
    bad: Sense
    limits: Bounds | None = None  # of its requirement

    def excess(self, values: Floats) -> Floats:
        """Signed distance [flight] beyond the limits (without any: the value itself, turned so that larger is worse),
        in the metric's unit; not-a-number is beyond every one."""
        if self.limits is None:
            return severity(values, self.bad)
        return severity(self.limits.worse(values) - self.limits.limit, "high")

    def scale(self, values: Floats) -> tuple[float, float]:
        """From where an excess is measured, and in what: from the limits in their size, which is the 5 to 95 % span of
        these ``values`` [flight] where the limit is 0; without limits from their median in its size."""
        excess = self.excess(values)
        finite = excess[np.isfinite(excess)]
        start = 0.0 if self.limits or not finite.size else float(np.median(finite))
        return start, (self.limits.size if self.limits else abs(start)) or spread(values)


def spread(values: Floats) -> float:
    """95 minus 5 % quantile of the finite values; 1 where there is none."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, _SPREAD) if finite.size else (0.0, 0.0)
    return float(high - low) or 1.0


def worst_first(lost_at: Floats, beyond: Floats) -> NDArray[np.intp]:
    """The flights, the worst first: those that were lost by the time of their end (``lost_at`` [flight], infinite for
    the others), then by their distance ``beyond`` a limit, the largest first; of equals the first."""
    return np.lexsort((-beyond, lost_at))


def sorted_quantile(ascending: Floats, probability: float) -> float:
    """numpy's `linear` quantile of values in ascending order, which may end in infinities."""
    position = (ascending.size - 1) * probability
    below = int(position)
    part = position - below
    if part == 0.0 or below + 1 >= ascending.size:
        return float(ascending[below])
    low, high = float(ascending[below]), float(ascending[below + 1])
    return high if low == high or np.isinf(high) else low + part * (high - low)


def quantile(values: Floats, probability: float, confidence: float = 0.95) -> Interval:
    """The `probability` quantile with its exact, distribution-free two-sided interval from order statistics."""
    return quantiles(values, (probability,), confidence)[0]


def quantiles(
    values: Floats, probabilities: Sequence[float], confidence: float = 0.95
) -> list[Interval]:
    """The same for several probabilities, the values sorted once."""
    ascending, tail, found = np.sort(values), (1.0 - confidence) / 2.0, []
    for probability in probabilities:
        if not ascending.size:
            found.append(Interval(np.nan, -np.inf, np.inf))
            continue
        lower = quantile_upper_rank(
            ascending.size, 1.0 - probability, 1.0 - tail
        )  # counted from the other end
        upper = quantile_upper_rank(ascending.size, probability, 1.0 - tail)
        ends = (
            -np.inf if lower is None else ascending[-lower],
            np.inf if upper is None else ascending[upper - 1],
        )
        found.append(Interval(sorted_quantile(ascending, probability), *map(float, ends)))
    return found


def pair_differences(a: Floats, b: Floats) -> Floats:
    """`a - b` pair by pair; where both are infinite the pair is a tie, 0."""
    both = np.isinf(a) & np.isinf(b)
    with np.errstate(invalid="ignore"):
        return np.where(both, 0.0, a - b)


def looks(flights: int, number: int = 24, first: int = 20) -> list[int]:
    """Numbers of flights after which to see how an estimate settled, evenly spaced by ratio, the last being all."""
    if flights <= first:
        return [flights]
    return np.unique(np.round(np.geomspace(first, flights, number)).astype(np.int64)).tolist()


def quantile_traces(values: Floats, counts: Sequence[int]) -> list[tuple[Interval, ...]]:
    """Quantiles of the first n of `values` [flight] for each n in `counts`, one trace for each of LEVELS."""
    return list(zip(*(quantiles(values[:n], LEVELS) for n in counts), strict=True))


def failure_trace(failed: Mask, counts: Sequence[int]) -> list[Interval]:
    """Share of failures among the first n flights for each n in `counts`, with its exact interval."""
    totals = np.cumsum(failed)[np.array(counts) - 1].tolist()
    return [Interval(k / n, *clopper_pearson(k, n)) for k, n in zip(totals, counts, strict=True)]
