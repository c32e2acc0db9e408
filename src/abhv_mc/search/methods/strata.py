"""A rare event where some parameters are switches: they come with a probability, or not at all.

P = sum over combinations of switches of P(combination) P(event | combination), the heaviest combinations each by plain
sampling or subset simulation, all others as one stratum that is sampled plainly. A level of subset simulation over all
at once would meet a rare switch in no flight. The intervals of the parts are joined as independent ones (Zou & Donner,
"Construction of confidence limits about effect measures", Statistics in Medicine 27, 2008).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import LANES, make_generator, round_up
from abhv_mc.search.methods.rare import CONFIDENCE, FEWEST, RareEstimate, estimate_rare
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.statistics.binomial import clopper_pearson

Switched = NDArray[np.bool_]  # [point, switch]
EvaluateSwitched = Callable[[Floats, Switched], Floats]

MOST_COMBINATIONS = 32
_PLACE = 1 << 21  # of the random numbers of plain flights
_PILOT = 2 * LANES  # plain flights of each combination
_FEWEST_FAILURES = 4  # of a pilot with which plain flights do
_MAIN_SHARE = 0.7  # of the flights, for the heaviest combination where there are several
_MOST_PLAIN = 2560  # plain flights before subset simulation takes over
_BEYOND_DEEPEST = 3.0  # factor on the deepest level that no repetition passed
_MOST_LISTED = 4096  # combinations that are weighed


@dataclass(frozen=True)
class Stratum:
    """One combination of switches, or all that are left."""

    on: tuple[int, ...] | None  # switches that are on; None: all combinations that are left
    weight: float  # probability of the combination
    probability: float  # of the event, given the combination
    low: float
    high: float
    flights: int


def list_combinations(probabilities: Floats) -> list[tuple[tuple[int, ...], float]]:
    """Combinations of independent switches with their probabilities, the heaviest first, at most a few thousand."""
    switches = range(len(probabilities))
    odds = probabilities / (1.0 - probabilities)
    none = float(np.prod(1.0 - probabilities))
    listed: list[tuple[tuple[int, ...], float]] = []
    for number in range(len(probabilities) + 1):
        more = [(on, none * float(np.prod(odds[list(on)]))) for on in combinations(switches, number)]
        listed += more
        if len(listed) + len(more) * len(probabilities) > _MOST_LISTED:
            break
    return sorted(listed, key=lambda entry: -entry[1])


class _Strata:
    """Flies combinations and remembers what they cost."""

    def __init__(self, evaluate: EvaluateSwitched, switches: int, plan: SubsetPlan, flights: int) -> None:
        self.evaluate, self.switches, self.plan, self.flights = evaluate, switches, plan, flights
        self.used = 0

    @property
    def left(self) -> int:
        return self.flights - self.used

    def _call(self, points: Floats, on: Switched) -> Floats:
        self.used += len(points)
        return self.evaluate(points, on)

    def rows(self, on: tuple[int, ...], number: int) -> Switched:
        row = np.zeros(self.switches, bool)
        row[list(on)] = True
        return np.broadcast_to(row, (number, self.switches))

    def plainly(self, place: int, begun: int, flights: int, on: Callable[[int], Switched]) -> int:
        """Failures among plain flights."""
        points = make_generator(self.plan.seed, _PLACE + place, begun).standard_normal((flights, self.plan.dimension))
        return int(np.sum(self._call(points, on(flights)) > self.plan.threshold))

    def subset(self, place: int, on: tuple[int, ...], flights: int, target_cov: float) -> RareEstimate:
        """Subset simulation within one combination."""
        plan = replace(self.plan, seed=self.plan.seed + (place << 64))  # its own random numbers
        return estimate_rare(lambda u: self._call(u, self.rows(on, len(u))), plan, target_cov, flights)


def estimate_switched(
    evaluate: EvaluateSwitched,
    probabilities: Floats,
    plan: SubsetPlan,
    target_cov: float = 0.2,
    flights: int = 20000,
) -> tuple[RareEstimate, tuple[Stratum, ...]]:
    """P(severity > threshold) where switches [switch] come with `probabilities`, and what each combination adds.

    `evaluate` gives severities [point] of standard normal points [point, dimension] and of the switches that are on
    [point, switch]. The estimate's repetitions are those of the heaviest combination that subset simulation flew.
    """
    if not len(probabilities):
        return estimate_rare(lambda u: evaluate(u, np.zeros((len(u), 0), bool)), plan, target_cov, flights), ()
    listed = list_combinations(probabilities)
    chosen, others = listed[:MOST_COMBINATIONS], listed[MOST_COMBINATIONS:]
    strata = _Strata(evaluate, len(probabilities), plan, flights)
    found: list[Stratum] = []
    main: RareEstimate | None = None
    refusal: str | None = None
    for place, (on, weight) in enumerate(chosen):
        start = strata.used
        failures, number = strata.plainly(place, 0, _PILOT, lambda n, on=on: strata.rows(on, n)), _PILOT  # type: ignore[misc]
        total = sum(part.weight * part.probability for part in found)
        expected = _plain_flights(failures, number, weight, total, target_cov)
        allowed = strata.left - _PILOT * (len(chosen) - place)
        if number < expected <= min(_MOST_PLAIN, allowed):
            more = round_up(expected - number)
            failures += strata.plainly(place, 1, more, lambda n, on=on: strata.rows(on, n))  # type: ignore[misc]
            number += more
        low, high = clopper_pearson(failures, number, CONFIDENCE)
        part = Stratum(on, weight, failures / number, low, high, strata.used - start)
        budget = int(_MAIN_SHARE * flights) if main is None and len(chosen) > 1 else allowed
        if expected > number and failures < _FEWEST_FAILURES and min(budget, allowed) >= FEWEST * plan.size:
            one = strata.subset(place, on, min(budget, allowed), target_cov)
            main = main or one
            part, reason = _of_subset(part, one)
            if reason and weight * part.high > target_cov * max(total, 0.0):
                words = "no switch on" if not on else f"{len(on)} switch{'es' * (len(on) > 1)} on"
                refusal = refusal or f"with {words}: {reason}"
            part = replace(part, flights=strata.used - start)
        found.append(part)
    if others:
        found.append(_others(strata, len(chosen), others, 1.0 - sum(weight for _, weight in chosen)))
    return _join(found, main, refusal, strata.used), tuple(found)


def _plain_flights(failures: int, flights: int, weight: float, total: float, target_cov: float) -> int:
    """Plain flights with which a combination is known well enough, from what the pilot and the others show."""
    if failures >= _FEWEST_FAILURES:
        share = failures / flights
        return int((1.0 - share) / (share * (0.5 * target_cov) ** 2))
    if total <= 0.0:
        return 1 << 60
    return int(3.7 * weight / (0.5 * target_cov * total))  # that none fails then leaves little


def _of_subset(part: Stratum, one: RareEstimate) -> tuple[Stratum, str | None]:
    """What subset simulation says of a combination, and why that is not to be trusted."""
    if one.refusal is None:
        return replace(part, probability=one.probability, low=one.low, high=one.high), None
    if any(repetition.reached for repetition in one.repetitions):
        return part, one.refusal
    deepest = max(float(np.prod([level.probability for level in r.levels])) for r in one.repetitions)
    return replace(part, probability=0.0, low=0.0, high=min(part.high, _BEYOND_DEEPEST * deepest)), one.refusal


def _others(strata: _Strata, place: int, others: list[tuple[tuple[int, ...], float]], weight: float) -> Stratum:
    """All combinations that are left, as they come among themselves."""
    flights = max(_PILOT, min(strata.left, 8 * _PILOT) // LANES * LANES)
    shares = np.array([one for _, one in others])
    picks = make_generator(strata.plan.seed, _PLACE + place, 1).choice(len(others), flights, p=shares / shares.sum())
    on = np.zeros((flights, strata.switches), bool)
    for row, pick in enumerate(picks.tolist()):
        on[row, list(others[pick][0])] = True
    failures = strata.plainly(place, 0, flights, lambda _: on)
    low, high = clopper_pearson(failures, flights, CONFIDENCE)
    return Stratum(None, weight, failures / flights, low, high, flights)


def _join(found: list[Stratum], main: RareEstimate | None, refusal: str | None, used: int) -> RareEstimate:
    """The sum of all combinations, with the interval of a sum of independent estimates."""
    weight, value, low, high = (
        np.array([getattr(part, key) for part in found]) for key in ("weight", "probability", "low", "high")
    )
    total = float(weight @ value)
    low_end = max(0.0, total - float(np.linalg.norm(weight * (value - low))))
    high_end = min(1.0, total + float(np.linalg.norm(weight * (high - value))))
    if refusal is None and (total == 0.0 or high_end > 10.0 * low_end):
        refusal = f"the combinations leave it between {low_end:.1g} and {high_end:.1g}"
    cov = (high_end - low_end) / (3.92 * total) if total > 0.0 else np.inf
    repetitions, check = (main.repetitions, main.check) if main else ((), None)
    return RareEstimate(total, low_end, high_end, cov, used, repetitions, check, refusal)
