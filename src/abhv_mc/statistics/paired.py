"""Paired comparison of two controllers on the same flights."""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.binomial import mcnemar_exact
from abhv_mc.statistics.estimates import Interval, pair_differences, quantile


@dataclass(frozen=True)
class PairedMetric:
    """Comparison of one metric of `a` and `b` on the same flights; differences are `a - b`.

    Values are severities: larger values are worse.
    """

    a_better: int
    b_better: int
    ties: int
    median_difference: Interval  # median of the paired differences, with its exact interval
    # factor by which an unpaired comparison of means would need more flights
    pairing_gain: float | None


def compare_metric(a: Floats, b: Floats) -> PairedMetric:
    """Compare severities [pair] on the same flights; +infinity marks an early termination."""
    difference = pair_differences(a, b)
    a_better, b_better = int(np.sum(difference < 0.0)), int(np.sum(difference > 0.0))
    return PairedMetric(
        a_better=a_better,
        b_better=b_better,
        ties=a.size - a_better - b_better,
        median_difference=quantile(difference, 0.5),
        pairing_gain=pairing_gain(a, b),
    )


def pairing_gain(a: Floats, b: Floats) -> float | None:
    """Return the ratio of the variances of an unpaired and a paired mean difference.

    The result is None for fewer than three finite pairs or for identical differences.
    """
    finite = np.isfinite(a) & np.isfinite(b)
    if finite.sum() < 3:
        return None
    unpaired = float(np.var(a[finite]) + np.var(b[finite]))
    paired = float(np.var(a[finite] - b[finite]))
    return unpaired / paired if paired > 1e-24 * max(unpaired, 1e-300) else None


@dataclass(frozen=True)
class PairedFailures:
    """Paired comparison of the failures of `a` and `b` (McNemar's exact test)."""

    both: int
    only_a: int
    only_b: int
    neither: int
    p_value: float


def compare_failures(a: Mask, b: Mask) -> PairedFailures:
    """Count the pairs in which both controllers fail, and those in which only one fails."""
    only_a, only_b = int(np.sum(a & ~b)), int(np.sum(b & ~a))
    return PairedFailures(
        int(np.sum(a & b)), only_a, only_b, int(np.sum(~a & ~b)), mcnemar_exact(only_a, only_b)
    )


def median_ratio(a: Floats, b: Floats) -> Interval | None:
    """Return the median of `a / b` with its exact interval; None if there are too few pairs."""
    usable = np.isfinite(a) & np.isfinite(b) & (a > 0.0) & (b > 0.0)
    with np.errstate(over="ignore"):  # Division by a tiny value may overflow.
        return quantile(a[usable] / b[usable], 0.5) if usable.sum() >= 3 else None
