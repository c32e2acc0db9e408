"""Two controllers on the same flights: who is better flight by flight, by how much, and what pairing saved."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.bootstrap import PairedBootstrap, quantile_differences
from abhv_mc.statistics.estimates import (
    LEVELS,
    Floats,
    Interval,
    pair_differences,
    paired_median_difference,
    quantile,
)
from abhv_mc.statistics.verdicts import mcnemar_exact

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class MetricDuel:
    """One metric of `a` against `b`, larger being worse; differences are `a - b`."""

    pairs: int
    a_better: int
    b_better: int
    ties: int
    median_difference: Interval  # of the pairs, exact
    quantile_differences: list[Interval]  # at `levels`, by the paired bootstrap
    levels: tuple[float, ...]
    pairing_gain: float | None  # how many times the flights an unpaired comparison of means would need

    @property
    def mixed(self) -> bool:
        """Whether the one with the smaller error on more flights has the larger median error."""
        medians = next(
            (i for level, i in zip(self.levels, self.quantile_differences, strict=True) if level == 0.5), None
        )
        if medians is None:
            return False
        return (self._ahead == "a" and medians.value > 0.0) or (self._ahead == "b" and medians.value < 0.0)

    @property
    def winner(self) -> str:
        """'a', 'b', or '' where the interval of the median difference holds zero or the medians contradict it."""
        return "" if self.mixed else self._ahead

    @property
    def _ahead(self) -> str:
        return "a" if self.median_difference.high < 0.0 else "b" if self.median_difference.low > 0.0 else ""


def metric_duel(
    a: Floats, b: Floats, bootstrap: PairedBootstrap, levels: tuple[float, ...] = LEVELS, confidence: float = 0.95
) -> MetricDuel:
    """Compare severities [pair] of the same flights; +infinity marks a failed flight."""
    difference = pair_differences(a, b)
    a_better, b_better = int(np.sum(difference < 0.0)), int(np.sum(difference > 0.0))
    return MetricDuel(
        pairs=a.size,
        a_better=a_better,
        b_better=b_better,
        ties=a.size - a_better - b_better,
        median_difference=paired_median_difference(a, b, confidence),
        quantile_differences=quantile_differences(a, b, levels, bootstrap, confidence),
        levels=levels,
        pairing_gain=pairing_gain(a, b),
    )


def pairing_gain(a: Floats, b: Floats) -> float | None:
    """Variance of the mean difference without pairing over that with it; None where it cannot be told."""
    finite = np.isfinite(a) & np.isfinite(b)
    if finite.sum() < 3:
        return None
    apart = float(np.var(a[finite]) + np.var(b[finite]))
    together = float(np.var(a[finite] - b[finite]))
    return apart / together if together > 1e-24 * max(apart, 1e-300) else None


@dataclass(frozen=True)
class FailureDuel:
    """Failures of `a` and `b` on the same flights, with McNemar's exact test."""

    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float


def failure_duel(a: Flags, b: Flags) -> FailureDuel:
    """Cross-count the failures [pair] of two controllers."""
    only_a, only_b = int(np.sum(a & ~b)), int(np.sum(b & ~a))
    return FailureDuel(int(np.sum(a & b)), only_a, only_b, int(np.sum(~a & ~b)), mcnemar_exact(only_a, only_b))


@dataclass(frozen=True)
class UsageDuel:
    """Tracking error against control usage, flight by flight, of `a` beside `b`."""

    pairs: int  # with finite, positive values
    error_ratio: Interval  # median of a/b, exact interval
    usage_ratio: Interval
    less_error_less_usage: int  # a has the smaller error and no more usage
    less_error_more_usage: int
    more_error_less_usage: int
    more_error_more_usage: int


def median_ratio(a: Floats, b: Floats) -> Interval | None:
    """Median of `a / b` over the pairs with its exact interval; None where too few can be divided."""
    kept = np.isfinite(a) & np.isfinite(b) & (a > 0.0) & (b > 0.0)
    return quantile(a[kept] / b[kept], 0.5) if kept.sum() >= 3 else None


def usage_duel(error_a: Floats, error_b: Floats, usage_a: Floats, usage_b: Floats) -> UsageDuel | None:
    """Whether the smaller error is bought with more control; None where too few pairs can be divided."""
    values = np.stack([error_a, error_b, usage_a, usage_b])
    kept = np.all(np.isfinite(values) & (values > 0.0), axis=0)
    if kept.sum() < 3:
        return None
    error_a, error_b, usage_a, usage_b = values[:, kept]
    less_error, less_usage = error_a < error_b, usage_a <= usage_b
    return UsageDuel(
        pairs=int(kept.sum()),
        error_ratio=quantile(error_a / error_b, 0.5),
        usage_ratio=quantile(usage_a / usage_b, 0.5),
        less_error_less_usage=int(np.sum(less_error & less_usage)),
        less_error_more_usage=int(np.sum(less_error & ~less_usage)),
        more_error_less_usage=int(np.sum(~less_error & less_usage)),
        more_error_more_usage=int(np.sum(~less_error & ~less_usage)),
    )
