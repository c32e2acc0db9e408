"""Whether a change may pass: `b` at most so much worse than `a` on the same flights, in most of them, in the tail and
in what it loses.

Non-inferiority is shown for the median of the pairs alone. Of a tail quantile, of lost and of failed flights it is
tested whether they are worse: non-inferiority of a tail quantile at 300 flights passes the identical law in 67 of 100.
The risks below follow from `benchmarks/gate.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.statistics.binomial import clopper_pearson, mcnemar_one_sided
from abhv_mc.statistics.family import holm
from abhv_mc.statistics.winner import worse_tails

RISK = 0.05  # of each test; the two quantiles of the tail share it, and so do the requirements


@dataclass(frozen=True)
class Gate:
    """What was found; whatever is true or not empty from `worse_tails` on stops `b`."""

    margin: float  # share of the value of `a`
    pairs: int
    within: int  # pairs in which b <= a + margin |a|
    within_low: float  # one-sided bound on the share of such pairs
    worse_tails: tuple[
        float, ...
    ]  # quantiles of `b` that are shown to lie beyond those of a + margin |a|
    worst_doubled: (
        bool  # whether b's worst flight that is not lost exceeds a's by more than its size
    )
    loses_more: bool
    misses_more: tuple[int, ...]  # requirements, by their place
    at: str = ""  # values of unknowns, in words

    shown: bool = field(init=False)  # whether `b` passes

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
    """Judge severities [pair], larger being worse and +infinity a lost flight; `risk` is of each test of what is worse.

    ``lost`` and each of ``missed`` (a requirement) are masks [pair] of `a` and of `b`. On most flights `b` is at most
    `margin` |a| worse by the sign test: for positive metrics the median ratio of the pairs is at most 1 + margin. A
    flight that both lost is no worse under `b`.
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
