"""Comparison of two controllers on the same flights, in one metric and in failures.

The winner has the smaller value in most of the flights that differ, is not significantly worse in
the tails, and does not have significantly more early terminations. The majority is tested by a mean
likelihood ratio against a fair coin, which is valid at any number of flights. All metrics and pairs
of controllers of a campaign share the risk of a false winner (Bonferroni); early terminations are
a family of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Literal, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.binomial import mcnemar_exact
from abhv_mc.statistics.estimates import Interval, pair_differences, quantile
from abhv_mc.statistics.evidence import log_beta_part
from abhv_mc.statistics.quantile_pairs import quantile_difference


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


Side = Literal["a", "b", ""]

RISK = 0.05  # risk of naming any winner in a campaign without differences
TAILS = (0.95, 0.9973)  # quantile levels at which a winner must not be worse


class Decision(NamedTuple):
    """Result of comparing `a` and `b` in one metric on the same flights."""

    # controller with the smaller value in most of the flights that differ; '' if not significant
    closer: Side
    # quantile levels at which `closer` is significantly worse
    worse: tuple[float, ...] = ()
    # quantile levels for which there are too few flights
    uncompared: tuple[float, ...] = ()
    loses_more: bool = False  # whether `closer` has significantly more early terminations

    @property
    def winner(self) -> Side:
        """The controller `closer`, or '' if it is worse in a tail or terminates more often."""
        return "" if self.worse or self.loses_more else self.closer


def decide(
    a: Floats, b: Floats, lost_a: Mask, lost_b: Mask, metrics: int, *, pairs: int = 1
) -> Decision:
    """Compare the severities [pair] of two controllers; larger is worse.

    Early terminations have the severity +infinity. The masks `lost_a` and `lost_b` [pair] mark all
    early terminations, including those with a finite severity. `metrics` and `pairs` are the
    numbers of metrics and of pairs of controllers that are judged together.
    """
    comparisons = metrics * pairs
    confidence = 1.0 - RISK / comparisons
    difference = pair_differences(a, b)
    better, worse = int(np.sum(difference < 0.0)), int(np.sum(difference > 0.0))
    if log_coin_evidence(max(better, worse), min(better, worse)) < log(
        2.0 * comparisons / RISK
    ):  # The risk is halved because either controller may win.
        return Decision("")
    if better < worse:
        a, b, lost_a, lost_b = b, a, lost_b, lost_a
    # In the following, `a` is the controller that is better in more flights.
    tails, uncompared = worse_tails(a, b, confidence)
    lost = compare_failures(lost_a, lost_b)
    loses_more = lost.only_a > lost.only_b and lost.p_value <= RISK / pairs
    return Decision("a" if better > worse else "b", tails, uncompared, loses_more)


def log_coin_evidence(heads: int, tails: int) -> float:
    """Return the log of the mean likelihood ratio between heads-favouring and fair coins."""
    return log_beta_part(tails + 1.0, heads + 1.0, 0.5) - log(2.0)


def agree(decisions: Sequence[Decision]) -> Decision:
    """Return the decision that holds at every point of the unknowns.

    If the points disagree, `closer` is empty. A winner must win at every point, so the risk of each
    test need not be reduced for several points.
    """
    sides = {decision.closer for decision in decisions}
    if len(sides) > 1:
        return Decision("")
    worse = {level for decision in decisions for level in decision.worse}
    uncompared = {level for decision in decisions for level in decision.uncompared}
    loses_more = any(decision.loses_more for decision in decisions)
    return Decision(sides.pop(), tuple(sorted(worse)), tuple(sorted(uncompared)), loses_more)


def worse_tails(
    a: Floats, b: Floats, confidence: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the quantile levels at which `a` is worse, and levels that cannot be compared.

    A quantile that cannot be compared is replaced by the outermost quantile for which the flights
    give a bound. `confidence` is two-sided: a quantile is falsely called worse with a chance of at
    most (1 - confidence) / 2.
    """
    worse, uncompared = [], []
    # highest quantile level for which the flights give a bound
    outermost = float(((1.0 - confidence) / 4.0) ** (1.0 / a.size))
    for level in TAILS:
        difference = quantile_difference(a, b, level, confidence)
        if difference.low > 0.0:
            worse.append(level)
        elif np.isneginf(difference.low) and not difference.high < 0.0:
            uncompared.append(level)
            if outermost > 0.5 and quantile_difference(a, b, outermost, confidence).low > 0.0:
                worse.append(outermost)
    return tuple(dict.fromkeys(worse)), tuple(uncompared)
