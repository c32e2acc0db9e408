"""Stopping when proven, honestly: verdicts at several looks whose total risk is what one look would have.

Group-sequential exact test: at each look the failures so far are held against an acceptance number and a rejection
number. Both come from one nominal level (Pocock 1977), the largest with which the exact chance of ever crossing,
for a system just at the required probability, stays within the allowed risk. Peeking with the numbers of a single
look would not: the chances of the looks add up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import binom

from abhv_mc.statistics.verdicts import runs_needed

Settled = Literal["PASS", "FAIL", "NOT SHOWN"]
_RATIO = 1.3  # between looks
_BISECTIONS = 50


@dataclass(frozen=True)
class SequentialPlan:
    """When to look, and with how many failures a requirement is settled then."""

    probability: float  # the required success probability
    risk: float  # allowed for a false PASS, and for a false FAIL
    looks: tuple[int, ...]  # flights, ascending
    accept: tuple[int, ...]  # PASS with at most so many failures; -1 where no count is few enough
    reject: tuple[int, ...]  # FAIL with at least so many; more than the flights where no count is enough
    false_pass: float  # exact chance of ever passing at the required probability
    false_fail: float  # exact chance of ever failing there


@dataclass(frozen=True)
class SequentialVerdict:
    """What a campaign's failures, in flight order, say at the look that settles them."""

    status: Settled
    flights: int  # of the look that settled it, or of the last one
    failures: int


def choose_looks(probability: float, risk: float, most: int) -> tuple[int, ...]:
    """Looks from the first count that could pass, growing by a fixed ratio, ending at `most` flights."""
    first = runs_needed(0, probability, risk)
    looks: list[int] = []
    count = float(first)
    while count * (1.0 + _RATIO) / 2.0 < most:  # no look just before the last
        looks.append(round(count))
        count *= _RATIO
    return (*looks, most)


@lru_cache(maxsize=256)
def make_sequential_plan(looks: tuple[int, ...], probability: float, risk: float) -> SequentialPlan:
    """Acceptance and rejection numbers for flights looked at after `looks` of them."""
    if not looks or any(b <= a for a, b in zip((0, *looks), looks, strict=False)):
        raise ValueError(f"looks must ascend from 1, found {list(looks)}")
    if not (0.0 < probability < 1.0 and 0.0 < risk < 1.0):
        raise ValueError(f"probability and risk must lie between 0 and 1, found {probability} and {risk}")
    counts = np.asarray(looks, dtype=np.int64)
    failure = 1.0 - probability

    def accept_at(level: float) -> NDArray[np.int64]:
        # The largest count with a lower tail of at most `level`; ppf gives the first with more.
        return np.asarray(binom.ppf(level, counts, failure), dtype=np.int64) - 1

    def reject_at(level: float) -> NDArray[np.int64]:
        # The smallest count with an upper tail of at most `level`.
        return np.asarray(binom.isf(level, counts, failure), dtype=np.int64) + 1

    accept, false_pass = _widest(accept_at, lambda bounds: _crossing(counts, bounds, failure, low=True), risk)
    reject, false_fail = _widest(reject_at, lambda bounds: _crossing(counts, bounds, failure, low=False), risk)
    return SequentialPlan(
        probability, risk, tuple(looks), tuple(accept.tolist()), tuple(reject.tolist()), false_pass, false_fail
    )


def _widest(
    bounds_at: Callable[[float], NDArray[np.int64]], chance: Callable[[NDArray[np.int64]], float], risk: float
) -> tuple[NDArray[np.int64], float]:
    """Bounds of the largest nominal level whose chance of ever crossing is within the risk, and that chance."""
    low, high = 1e-300, risk
    bounds = bounds_at(low)
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high)) if low < 1e-6 else (low + high) / 2.0
        tried = bounds_at(middle)
        if chance(tried) <= risk:
            low, bounds = middle, tried
        else:
            high = middle
    return bounds, chance(bounds)


def _crossing(looks: NDArray[np.int64], bounds: NDArray[np.int64], failure: float, low: bool) -> float:
    """Exact chance that the failures are ever at most (`low`) or at least the bound of a look."""
    # Counts above the last acceptance number can never pass, counts at the last rejection number have failed before:
    # the others are all that has to be followed.
    size = int(max(bounds.max() + 1, 1)) if low else int(bounds.max())
    inside = np.zeros(size)
    inside[0] = 1.0
    crossed, before = 0.0, 0
    for look, bound in zip(looks.tolist(), bounds.tolist(), strict=True):
        more = binom.pmf(np.arange(size), look - before, failure)
        reached = np.convolve(inside, more)[:size]
        if low:
            stop = min(bound + 1, size)
            crossed += float(reached[:stop].sum())
            reached[:stop] = 0.0
        else:
            # What left the followed counts crossed too: they reach no further than the largest bound.
            stayed = float(reached[: min(bound, size)].sum())
            crossed += float(inside.sum()) - stayed
            reached[min(bound, size) :] = 0.0
        inside, before = reached, look
    return crossed


def sequential_verdict(failed: NDArray[np.bool_], plan: SequentialPlan) -> SequentialVerdict:
    """The verdict on flights [flight] in flight order, at the first look that settles it.

    Looks that the flights do not reach are left out; what no look settles is NOT SHOWN.
    """
    totals = np.concatenate([[0], np.cumsum(failed)])
    flights = 0
    for look, accept, reject in zip(plan.looks, plan.accept, plan.reject, strict=True):
        if look > failed.size:
            break
        flights, failures = look, int(totals[look])
        if failures <= accept:
            return SequentialVerdict("PASS", look, failures)
        if failures >= reject:
            return SequentialVerdict("FAIL", look, failures)
    return SequentialVerdict("NOT SHOWN", flights, int(totals[flights]))


def at_least_as_good(verdict: SequentialVerdict, plan: SequentialPlan, probability: float) -> float:
    """Chance of an outcome at least as good as this one when the success probability is `probability`.

    Outcomes in order of looks (Jennison & Turnbull, "Group Sequential Methods", 2000, chapter 12): the earlier a PASS
    the better, the earlier a FAIL the worse, and at the same look the fewer failures the better.
    """
    return _as_good(verdict.flights, verdict.failures, plan, probability)


def at_least_as_bad(verdict: SequentialVerdict, plan: SequentialPlan, probability: float) -> float:
    """Chance of an outcome at least as bad as this one when the success probability is `probability`."""
    return 1.0 - _as_good(verdict.flights, verdict.failures - 1, plan, probability)


def sequential_lower_bound(verdict: SequentialVerdict, plan: SequentialPlan) -> float:
    """One-sided lower bound on the success probability, wrong with at most the plan's risk in spite of the looks."""
    if verdict.failures >= verdict.flights:
        return 0.0
    least = 1e-12
    if at_least_as_good(verdict, plan, least) >= plan.risk:
        return 0.0
    bound = brentq(lambda p: at_least_as_good(verdict, plan, p) - plan.risk, least, 1.0 - 1e-15, xtol=1e-14)
    return float(bound)


def _as_good(flights: int, failures: int, plan: SequentialPlan, probability: float) -> float:
    """Chance to pass before the look at `flights`, or to reach it with at most so many failures."""
    if flights == 0:
        return 1.0
    earlier = [i for i, look in enumerate(plan.looks) if look < flights]
    # More failures than these neither pass nor count; failures only grow.
    size = 1 + max([failures, *(plan.accept[i] for i in earlier)])
    if size < 1:
        return 0.0
    inside = np.zeros(size)
    inside[0] = 1.0
    passed, before = 0.0, 0
    for i in earlier:
        more = binom.pmf(np.arange(size), plan.looks[i] - before, 1.0 - probability)
        inside = np.convolve(inside, more)[:size]
        stop = max(plan.accept[i] + 1, 0)
        passed += float(inside[:stop].sum())
        inside[:stop] = 0.0
        inside[plan.reject[i] :] = 0.0
        before = plan.looks[i]
    more = binom.pmf(np.arange(size), flights - before, 1.0 - probability)
    return passed + float(np.convolve(inside, more)[: max(failures + 1, 0)].sum())


def stopping_look(failed: Sequence[NDArray[np.bool_]], plans: Sequence[SequentialPlan]) -> int | None:
    """Flights after which every requirement is settled, each by its own plan; None while one is not."""
    verdicts = [sequential_verdict(flags, plan) for flags, plan in zip(failed, plans, strict=True)]
    if any(verdict.status == "NOT SHOWN" for verdict in verdicts):
        return None
    return max((verdict.flights for verdict in verdicts), default=None)
