"""Who is better in a metric: closer on more of the flights, not shown worse in the tails, and losing no more flights.

That one is closer on more than half of the flights that differ is shown by a mean of likelihood ratios against a fair
coin, over all larger chances alike: it holds at any number of flights. A campaign that compares several metrics with
several rivals names some winner by chance more often than each comparison does; so each holds at a share of the risk
(Bonferroni).
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

RISK = 0.05  # of naming any winner in a campaign without differences
TAILS = (0.95, 0.9973)  # quantiles in which a winner is not worse


@dataclass(frozen=True)
class Decision:
    """One metric of `a` against `b` on the same flights."""

    closer: Side  # on more than half of the flights that differ, '' where that is not shown
    worse: tuple[float, ...] = ()  # quantiles in which the closer one is shown to be worse
    uncompared: tuple[float, ...] = ()  # quantiles that so few flights do not compare
    loses_more: bool = False  # whether the closer one is shown to lose more flights

    @property
    def winner(self) -> Side:
        """The closer one, unless its tails or its lost flights say otherwise."""
        return "" if self.worse or self.loses_more else self.closer


def decide(
    a: Floats, b: Floats, lost_a: Mask, lost_b: Mask, comparisons: int, *, risk: float = RISK
) -> Decision:
    """Decide on severities [pair], larger being worse and +infinity a lost flight.

    `lost_a` and `lost_b` [pair] are the flights that each lost, whatever the metric says of them; `comparisons` are
    all metrics times rivals that are decided together.
    """
    confidence = 1.0 - risk / comparisons
    difference = pair_differences(a, b)
    better, worse = int(np.sum(difference < 0.0)), int(np.sum(difference > 0.0))
    if log_coin_evidence(max(better, worse), min(better, worse)) < log(
        2.0 * comparisons / risk
    ):  # either may win
        return Decision("")
    if better < worse:
        a, b, lost_a, lost_b = b, a, lost_b, lost_a
    # From here on `a` is the one that is better on more flights.
    tails, uncompared = worse_tails(a, b, confidence)
    lost = compare_failures(lost_a, lost_b)
    more = lost.only_a > lost.only_b and lost.p_value <= risk
    return Decision("a" if better > worse else "b", tails, uncompared, more)


def agree(found: Sequence[Decision]) -> Decision:
    """What holds at every value of the unknowns, of a decision at each: nobody is closer where they differ.

    A winner everywhere is one that wins each test, so that no test needs a smaller risk for their number.
    """
    sides = {each.closer for each in found}
    if len(sides) > 1:
        return Decision("")
    worse, uncompared = (
        tuple(sorted({level for each in found for level in levels(each)}))
        for levels in (lambda each: each.worse, lambda each: each.uncompared)
    )
    return Decision(sides.pop(), worse, uncompared, any(each.loses_more for each in found))


def worse_tails(
    a: Floats, b: Floats, confidence: float
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Quantiles in which `a` is worse, and those that the flights do not compare.

    Where they do not compare one, the outermost that they bound stands in for it. The two-sided ``confidence`` is that
    of each quantile: one of two is falsely called worse with a chance of at most 1 - confidence.
    """
    worse, uncompared = [], []
    # Beyond this one the flights bound nothing: where a tail is not compared, this one still is.
    outermost = float(((1.0 - confidence) / 4.0) ** (1.0 / a.size))
    for level in TAILS:
        found = quantile_difference(a, b, level, confidence)
        if found.low > 0.0:
            worse.append(level)
        elif np.isneginf(found.low) and not found.high < 0.0:
            uncompared.append(level)
            if outermost > 0.5 and quantile_difference(a, b, outermost, confidence).low > 0.0:
                worse.append(outermost)
    return tuple(dict.fromkeys(worse)), tuple(uncompared)
