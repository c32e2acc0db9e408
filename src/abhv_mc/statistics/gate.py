"""Regression gate: non-inferiority of controller `b` to `a` on the same flights.

Non-inferiority is shown only for the median of the pairs. Tail quantiles, early terminations and
violated requirements are only tested for a significant deterioration, because a non-inferiority
test of a tail quantile with 300 flights would pass an identical controller in only 67 of 100
campaigns. The risks were computed by `benchmarks/gate.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.binomial import clopper_pearson, mcnemar_one_sided
from abhv_mc.statistics.family import holm
from abhv_mc.statistics.winner import worse_tails

# risk of each test; it applies jointly to the two tail quantiles, and jointly to the requirements
RISK = 0.05


@dataclass(frozen=True)
class Gate:
    """Result of a regression gate on one metric."""

    margin: float  # allowed change as a share of the value of `a`
    pairs: int
    within: int  # number of pairs in which b <= a + margin |a|
    within_low: float  # one-sided lower bound on the share of pairs within the margin
    # levels at which the quantile of `b` is significantly beyond the quantile of a + margin |a|
    worse_tails: tuple[float, ...]
    # whether b's worst completed flight is worse than a's by more than the size of a's value
    worst_doubled: bool
    loses_more: bool
    misses_more: tuple[int, ...]  # indices of requirements that `b` violates more often
    at: str = ""  # values of the unknowns at the worst point, as text

    shown: bool = field(init=False)  # whether `b` passes the gate

    def __post_init__(self) -> None:
        stopped = self.worse_tails or self.worst_doubled or self.loses_more or self.misses_more
        object.__setattr__(self, "shown", self.within_low > 0.5 and not stopped)


def judge_change(
    a: Floats,
    b: Floats,
    lost: tuple[Mask, Mask],
    missed: Sequence[tuple[Mask, Mask]],
    margin: float,
    *,
    risk: float = RISK,
) -> Gate:
    """Judge the change from controller `a` to `b` by their severities [pair]; larger is worse.

    Early terminations have the severity +infinity and are marked in the masks `lost` [pair] of `a`
    and `b`. Each item of `missed` belongs to a requirement and contains two masks [pair], of the
    flights in which `a` violates it and of those in which `b` violates it. The sign test shows that
    `b` is worse by at most `margin` |a| in most flights: for positive metrics, the median ratio b /
    a is at most 1 + margin. `risk` applies to each test for a deterioration. A flight that
    terminates early under both controllers does not count against `b`.
    """
    with np.errstate(invalid="ignore"):
        allowed = np.where(np.isfinite(a), a + margin * np.abs(a), a)
    within = int(np.sum(b <= allowed))
    worst_a, worst_b = (
        float(np.max(values, where=np.isfinite(values), initial=-np.inf)) for values in (a, b)
    )
    p_lost, *p_missed = (
        mcnemar_one_sided(int(np.sum(x & ~y)), int(np.sum(y & ~x))) for x, y in (lost, *missed)
    )
    return Gate(
        margin=margin,
        pairs=a.size,
        within=within,
        within_low=clopper_pearson(within, a.size, 1.0 - 2.0 * RISK)[0],
        worse_tails=worse_tails(b, allowed, 1.0 - risk)[0],
        worst_doubled=bool(np.isfinite(worst_a) and worst_b - worst_a > abs(worst_a)),
        loses_more=p_lost <= risk,
        misses_more=tuple(k for k, rejected in enumerate(holm(p_missed, risk)) if rejected),
    )
