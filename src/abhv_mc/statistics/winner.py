"""Comparison of two controllers in one metric on the same flights.

The winner has the smaller value in most of the flights that differ, is not significantly worse in
the tails, and does not have significantly more early terminations. The majority is tested by a mean
likelihood ratio against a fair coin, which is valid at any number of flights. All metrics and pairs
of controllers of a campaign share the risk of a false winner (Bonferroni); early terminations are
a family of their own.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import log
from typing import Literal

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.estimates import pair_differences
from abhv_mc.statistics.evidence import log_coin_evidence
from abhv_mc.statistics.paired import compare_failures
from abhv_mc.statistics.quantile_pairs import quantile_difference

Side = Literal["a", "b", ""]

RISK = 0.05  # risk of naming any winner in a campaign without differences
TAILS = (0.95, 0.9973)  # quantile levels at which a winner must not be worse


@dataclass(frozen=True)
class Decision:
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


def agree(decisions: Sequence[Decision]) -> Decision:
    """Return the decision that holds at every point of the unknowns.

    If the points disagree, `closer` is empty. A winner must win at every point, so the risk of each
    test need not be reduced for several points.
    """
    sides = {decision.closer for decision in decisions}
    if len(sides) > 1:
        return Decision("")
    worse, uncompared = (
        tuple(sorted({level for decision in decisions for level in levels(decision)}))
        for levels in (lambda decision: decision.worse, lambda decision: decision.uncompared)
    )
    return Decision(
        sides.pop(), worse, uncompared, any(decision.loses_more for decision in decisions)
    )


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
