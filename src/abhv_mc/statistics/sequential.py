"""Stopping when proven, honestly: verdicts at several looks whose total risk is what one look would have.

Group-sequential exact test: at each look the failures so far are held against an acceptance number and a rejection
number. Each comes from a threshold on a mean likelihood ratio, the smallest with which the exact chance of ever
settling so, for a system just at the required probability, stays within the allowed risk. Peeking with the numbers
of a single look would not: the chances of the looks add up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.boundaries import Boundary, Counts, Mixture, looks_at
from abhv_mc.statistics.crossing import Crossing, cross

Settled = Literal["PASS", "FAIL", "NOT SHOWN"]
_TOLERANCE = 1e-4  # on the logarithm of a threshold
_COARSE = 0.01  # the same where looks are only placed: half a percent of the first
_LONGEST = 1e12  # step of such a logarithm: then all counts settle


@dataclass(frozen=True)
class SequentialPlan:
    """When to look, and with how many failures a requirement is settled then."""

    probability: float  # the required success probability
    risk: float  # allowed for a false PASS, and for a false FAIL
    looks: tuple[int, ...]  # flights, ascending
    accept: tuple[int, ...]  # PASS with at most so many failures; -1 where no count is few enough
    reject: tuple[int, ...]  # FAIL with at least so many; more than the flights where no count is enough
    false_pass: float  # exact chance to pass at the required probability
    false_fail: float  # exact chance to fail there

    def crossing(self, probability: float) -> Crossing:
        """Chances at each look for another success probability."""
        return cross(self.looks, self.accept, self.reject, 1.0 - probability)


@dataclass(frozen=True)
class SequentialVerdict:
    """What a campaign's failures, in flight order, say at the look that settles them."""

    status: Settled
    flights: int  # of the look that settled it, or of the last one
    failures: int


@lru_cache(maxsize=256)
def choose_looks(probability: float, risk: float, most: int) -> tuple[int, ...]:
    """Looks where one more failure still passes, and further apart later on, ending at `most` flights."""
    mixture = Mixture.good(1.0 - probability)

    def chance(threshold: float) -> float:
        looks = looks_at(mixture, threshold, most)
        counts = np.asarray(looks, dtype=np.int64)
        return _false(looks, Boundary(mixture, counts, low=True).at(threshold), counts + 1, probability)[0]

    low, high = 0.0, -float(np.log(risk))
    while high - low > _COARSE:
        middle = (low + high) / 2.0
        low, high = (low, middle) if chance(middle) <= risk else (middle, high)
    return looks_at(mixture, high, most)


@lru_cache(maxsize=256)
def make_sequential_plan(looks: tuple[int, ...], probability: float, risk: float) -> SequentialPlan:
    """The most decisive plan for `looks` [ascending flights] with exact risks of at most `risk`. Raises ValueError."""
    if not looks or looks[0] < 1 or any(b <= a for a, b in pairwise(looks)):
        raise ValueError(f"looks must ascend from 1, found {list(looks)}")
    if not (0.0 < probability < 1.0 and 0.0 < risk < 1.0):
        raise ValueError(f"probability and risk must lie between 0 and 1, found {probability} and {risk}")
    counts = np.asarray(looks, dtype=np.int64)
    passes = Boundary(Mixture.good(1.0 - probability), counts, low=True)
    fails = Boundary(Mixture.bad(1.0 - probability), counts, low=False)
    # Who failed cannot pass any more, and the other way round: each side is found beside the other. That only takes
    # chances away, so what was within the risk stays so.
    reject = _widest(fails, lambda tried: _false(looks, np.full_like(counts, -1), tried, probability)[1], risk)
    accept = _widest(passes, lambda tried: _false(looks, tried, reject, probability)[0], risk)
    reject = _widest(fails, lambda tried: _false(looks, accept, tried, probability)[1], risk)
    false_pass, false_fail = _false(looks, accept, reject, probability)
    return SequentialPlan(
        probability, risk, tuple(looks), tuple(accept.tolist()), tuple(reject.tolist()), false_pass, false_fail
    )


def _widest(boundary: Boundary, chance: Callable[[Counts], float], risk: float) -> Counts:
    """Numbers of the smallest threshold whose chance to settle falsely is within the risk."""
    # By Ville's inequality the threshold 1/risk is within the risk; that there is an end lets it come down.
    high, step = -float(np.log(risk)), 0.25
    tight = boundary.at(high)
    while chance(loose := boundary.at(high - step)) <= risk and step < _LONGEST:
        high, tight, step = high - step, loose, 4.0 * step
    low = high - step
    while high - low > _TOLERANCE and np.any(loose != tight):
        middle = (low + high) / 2.0
        tried = boundary.at(middle)
        if chance(tried) <= risk:
            high, tight = middle, tried
        else:
            low, loose = middle, tried
    return tight


def _false(looks: Sequence[int], accept: Counts, reject: Counts, probability: float) -> tuple[float, float]:
    """Exact chances of a false PASS and a false FAIL at the required probability."""
    found = cross(looks, accept.tolist(), reject.tolist(), 1.0 - probability)
    return float(found.passed.sum()), float(found.failed.sum())


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
    from scipy.optimize import brentq  # a third of a second of imports that most commands do not need

    bound = brentq(lambda p: at_least_as_good(verdict, plan, p) - plan.risk, least, 1.0 - 1e-15, xtol=1e-14)
    return float(bound)


def _as_good(flights: int, failures: int, plan: SequentialPlan, probability: float) -> float:
    """Chance to pass before the look at `flights`, or to reach it with at most so many failures."""
    if flights == 0:
        return 1.0
    earlier = sum(look < flights for look in plan.looks)
    looks = (*plan.looks[:earlier], flights)
    found = cross(looks, (*plan.accept[:earlier], failures), (*plan.reject[:earlier], flights + 1), 1.0 - probability)
    return float(found.passed.sum())


def stopping_look(failed: Sequence[NDArray[np.bool_]], plans: Sequence[SequentialPlan]) -> int | None:
    """Flights after which every requirement is settled, each by its own plan; None while one is not."""
    verdicts = [sequential_verdict(flags, plan) for flags, plan in zip(failed, plans, strict=True)]
    if any(verdict.status == "NOT SHOWN" for verdict in verdicts):
        return None
    return max((verdict.flights for verdict in verdicts), default=None)


def choose_common_looks(demands: Sequence[tuple[float, float]], most: int) -> tuple[int, ...]:
    """Looks that suit every one of several requirements, each (probability, risk)."""
    return tuple(sorted({look for demand in demands for look in choose_looks(*demand, most)}))
