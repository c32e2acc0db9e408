"""A rare event where some parameters are switches: they come with a probability, or not at all.

P = sum over combinations of switches of P(combination) P(event | combination): the heaviest by subset simulation, the
others by plain sampling, beyond 32 as one stratum. A level of subset simulation over all at once would meet a rare
switch in no flight. A combination that subset simulation does not finish has the interval of its plain flights. The
intervals of the parts are joined as independent ones (Zou & Donner, "Construction of confidence limits about effect
measures", Statistics in Medicine 27, 2008), those of parts without a failure exactly.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import LANES, make_generator
from abhv_mc.search.methods.rare import CONFIDENCE, FEWEST, RareEstimate, estimate_rare
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.statistics.binomial import clopper_pearson

Switched = NDArray[np.bool_]  # [point, switch]
EvaluateSwitched = Callable[[Floats, Switched], Floats]

MOST_COMBINATIONS = 32
_PLACE = 1 << 21  # of the random numbers of plain flights
_PILOT = 2 * LANES  # plain flights of each combination
_FEWEST_FAILURES = 4  # of a pilot with which plain flights do
_MAIN_SHARE = 0.75  # of the flights, for subset simulation
_MOST_PLAIN = 2560  # plain flights before subset simulation takes over
_MOST_AT_ONCE = 16 * LANES  # plain flights before it is asked again where they are worth most
_SHARE_OF_COV = 0.5  # of the coefficient of variation, that plain flights may leave
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

    @property
    def value(self) -> float:
        """What it adds to the sum."""
        return self.weight * self.probability


def list_combinations(probabilities: Floats) -> list[tuple[tuple[int, ...], float]]:
    """Combinations of independent switches with their probabilities, the heaviest first, at most a few thousand."""
    switches = range(len(probabilities))
    odds = probabilities / (1.0 - probabilities)
    none = float(np.prod(1.0 - probabilities))
    listed: list[tuple[tuple[int, ...], float]] = []
    for number in range(len(probabilities) + 1):
        more = [
            (on, none * float(np.prod(odds[list(on)]))) for on in combinations(switches, number)
        ]
        listed += more
        if len(listed) + len(more) * len(probabilities) > _MOST_LISTED:
            break
    return sorted(listed, key=lambda entry: -entry[1])


@dataclass
class _Part:
    """The plain flights of a stratum, and subset simulation's estimate where that finished."""

    on: tuple[int, ...] | None
    rows: Switched  # [combination, switch]
    weights: Floats  # [combination]
    place: int  # of its random numbers
    flights: int = 0
    failures: int = 0
    levels: int = 0  # flights of subset simulation beyond its plain ones
    estimate: RareEstimate | None = None

    def draw(self, flights: int, plan: SubsetPlan) -> tuple[Floats, Switched]:
        """Points and switches of its next plain flights."""
        generator = make_generator(plan.seed, _PLACE + self.place, self.flights)
        picks = generator.choice(len(self.rows), flights, p=self.weights / self.weights.sum())
        return generator.standard_normal((flights, plan.dimension)), self.rows[picks]

    def stratum(self) -> Stratum:
        """Subset simulation's interval, or Clopper and Pearson's."""
        low, high = clopper_pearson(self.failures, self.flights, CONFIDENCE)
        found = Stratum(
            self.on,
            float(self.weights.sum()),
            self.failures / self.flights,
            low,
            high,
            self.flights + self.levels,
        )
        one = self.estimate
        return (
            found
            if one is None
            else replace(found, probability=one.probability, low=one.low, high=one.high)
        )


def estimate_switched(
    evaluate: EvaluateSwitched,
    probabilities: Floats,
    plan: SubsetPlan,
    target_cov: float = 0.2,
    flights: int = 20000,
) -> tuple[RareEstimate, tuple[Stratum, ...]]:
    """P(severity > threshold) where switches [switch] come with `probabilities`, and what each combination adds.

    `evaluate` gives severities [point] of standard normal points [point, dimension] and of the switches that are on
    [point, switch]. All combinations are piloted; the heaviest (no switch on, where each comes less often than not) is
    estimated by subset simulation unless plain flights do; the flights that are left go where weight times width is
    largest. The estimate's repetitions are those of the heaviest combination.
    """
    if not len(probabilities):
        return estimate_rare(
            lambda u: evaluate(u, np.zeros((len(u), 0), bool)), plan, target_cov, flights
        ), ()
    used = 0

    def fly(points: Floats, on: Switched) -> Floats:
        nonlocal used
        used += len(points)
        return evaluate(points, on)

    def fly_plainly(which: list[_Part], number: int) -> None:
        points, on = zip(*(part.draw(number, plan) for part in which), strict=True)
        failed = fly(np.concatenate(points), np.concatenate(on)) > plan.threshold
        for part, failures in zip(
            which, failed.reshape(len(which), number).sum(axis=1), strict=True
        ):
            part.flights, part.failures = part.flights + number, part.failures + int(failures)

    parts = _list_parts(probabilities)
    fly_plainly(parts, int(np.clip(flights // (2 * len(parts)), LANES, _PILOT)) // LANES * LANES)
    main, seen = parts[0], sum(part.stratum().value for part in parts)
    # Where none of so many fails, little is left beside what the pilots have seen.
    enough = 3.7 * main.stratum().weight / (_SHARE_OF_COV * target_cov * seen) if seen else np.inf
    budget = min(int(_MAIN_SHARE * flights), flights - used)
    one: RareEstimate | None = None
    if main.failures < _FEWEST_FAILURES and enough > _MOST_PLAIN and budget >= FEWEST * plan.size:
        one = estimate_rare(
            lambda u: fly(u, main.rows.repeat(len(u), axis=0)), plan, target_cov, budget
        )
        main.estimate = one if one.refusal is None else None
        failures, number = (
            (0, 0) if main.estimate else one.plain
        )  # of levels without an estimate the first one counts
        main.flights, main.failures, main.levels = (
            main.flights + number,
            main.failures + failures,
            one.flights - number,
        )
    while flights - used >= LANES:
        plain = [part for part in parts if part.estimate is None]
        below, above = _ends([part.stratum() for part in plain])
        if below + above <= _SHARE_OF_COV * 3.92 * target_cov * sum(
            part.stratum().value for part in parts
        ):
            break
        widest = max(plain, key=lambda part: sum(_ends([part.stratum()])))
        fly_plainly([widest], min(widest.flights, _MOST_AT_ONCE, flights - used) // LANES * LANES)
    found = tuple(part.stratum() for part in parts)
    return _join(found, one, used), found


def _list_parts(probabilities: Floats) -> list[_Part]:
    """The heaviest combinations one by one, and all others as they come among themselves."""
    listed = list_combinations(probabilities)
    weights = np.array([weight for _, weight in listed])
    rows = np.array([np.isin(np.arange(len(probabilities)), on) for on, _ in listed])
    parts = [
        _Part(on, rows[[i]], weights[[i]], i)
        for i, (on, _) in enumerate(listed[:MOST_COMBINATIONS])
    ]
    if len(rest := weights[MOST_COMBINATIONS:]):
        rest *= (
            1.0 - weights[:MOST_COMBINATIONS].sum()
        ) / rest.sum()  # those that are not listed among them
        parts.append(_Part(None, rows[MOST_COMBINATIONS:], rest, len(parts)))
    return parts


def _ends(found: Sequence[Stratum]) -> tuple[float, float]:
    """How far the sum's interval reaches below and above the sum of these.

    Where none of n_i flights failed in any part i, -sum n_i log(1 - p_i) has one upper end for all of them together,
    and so the sum of weight times p_i: the largest of what each would add alone.
    """
    below = [part.weight * (part.probability - part.low) for part in found]
    above = [
        part.weight * (part.high - part.probability) for part in found if part.probability > 0.0
    ]
    clean = [-part.weight * np.log1p(-part.high) for part in found if part.probability == 0.0]
    return float(np.linalg.norm(below)), float(np.linalg.norm([*above, max(clean, default=0.0)]))


def _join(found: Sequence[Stratum], main: RareEstimate | None, used: int) -> RareEstimate:
    """The sum of all combinations, with its interval."""
    total = sum(part.value for part in found)
    below, above = _ends(found)
    low, high = max(0.0, total - below), min(1.0, total + above)
    refusal = None
    if total == 0.0 or high > 10.0 * low:
        refusal = f"the combinations leave it between {low:.1g} and {high:.1g}"
        if main and main.refusal:
            refusal += f"; of the likeliest, {main.refusal}"
    cov = (high - low) / (3.92 * total) if total > 0.0 else np.inf
    repetitions, check = (main.repetitions, main.check) if main else ((), None)
    return RareEstimate(total, low, high, cov, used, repetitions, check, refusal)
