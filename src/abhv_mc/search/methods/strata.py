"""Rare-event probability with switches, i.e. parameters that act in some flights only.

P is the sum over combinations of switches of P(combination) P(event | combination). The most
probable combination is estimated by subset simulation and the others by plain Monte Carlo sampling;
all combinations beyond the 32 most probable form one stratum. Subset simulation over all
combinations would miss a rare switch. If subset simulation does not finish, the interval from plain
flights is used. Intervals are combined as intervals of independent estimates (Zou & Donner,
"Construction of confidence limits about effect measures", Statistics in Medicine 27, 2008), or
exactly if there are no failures.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from abhv_mc.array_types import Floats, Mask
from abhv_mc.search.methods.evaluation import LANES, make_generator
from abhv_mc.search.methods.rare import CONFIDENCE, FEWEST, RareEstimate, estimate_rare
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.statistics.binomial import clopper_pearson

Switched = Mask  # mask of active switches [point, switch]
EvaluateSwitched = Callable[[Floats, Switched], Floats]

MOST_COMBINATIONS = 32
_PLACE = 1 << 21  # key of the random numbers used for plain flights
_PILOT = 2 * LANES  # number of plain flights of each combination
# minimum number of failures among pilot flights for which plain flights are enough
_FEWEST_FAILURES = 4
_MAIN_SHARE = 0.75  # share of the flights for subset simulation
_MOST_PLAIN = 2560  # maximum number of plain flights before subset simulation is used
_MOST_AT_ONCE = 16 * LANES  # maximum number of plain flights before the allocation is updated
_SHARE_OF_COV = 0.5  # share of the coefficient of variation that plain flights may contribute
_MOST_LISTED = 4096  # maximum number of combinations whose weights are computed


@dataclass(frozen=True)
class Stratum:
    """Combination of switches, or all remaining combinations together."""

    on: tuple[int, ...] | None  # switches that are on; None for all remaining combinations
    weight: float  # probability of the combination
    probability: float  # conditional probability of the event, given the combination
    low: float
    high: float
    flights: int

    @property
    def value(self) -> float:
        """Contribution of the stratum to the total probability."""
        return self.weight * self.probability


def list_combinations(probabilities: Floats) -> list[tuple[tuple[int, ...], float]]:
    """Return combinations of independent switches with probabilities, most probable first.

    The list contains at most a few thousand combinations.
    """
    switches = range(len(probabilities))
    odds = probabilities / (1.0 - probabilities)
    none = float(np.prod(1.0 - probabilities))
    listed = []
    for number in range(len(probabilities) + 1):
        weighted = [
            (on, none * float(np.prod(odds[list(on)]))) for on in combinations(switches, number)
        ]
        listed += weighted
        if len(listed) + len(weighted) * len(probabilities) > _MOST_LISTED:
            break
    return sorted(listed, key=lambda entry: -entry[1])


@dataclass
class _Sampler:
    """Plain Monte Carlo flights of a stratum, and the stratum's subset simulation, if any."""

    on: tuple[int, ...] | None
    rows: Switched  # mask of active switches [combination, switch]
    weights: Floats  # probability of each combination [combination]
    place: int  # key of the stratum's random numbers
    flights: int = 0
    failures: int = 0
    levels: int = 0  # number of flights used by subset simulation in addition to the plain flights
    estimate: RareEstimate | None = None

    def draw(self, flights: int, plan: SubsetPlan) -> tuple[Floats, Switched]:
        """Return points and switches for the next plain flights."""
        generator = make_generator(plan.seed, _PLACE + self.place, self.flights)
        picks = generator.choice(len(self.rows), flights, p=self.weights / self.weights.sum())
        return generator.standard_normal((flights, plan.dimension)), self.rows[picks]

    def stratum(self) -> Stratum:
        """Return the stratum with its interval from subset simulation or Clopper-Pearson."""
        low, high = clopper_pearson(self.failures, self.flights, CONFIDENCE)
        plain = Stratum(
            self.on,
            float(self.weights.sum()),
            self.failures / self.flights,
            low,
            high,
            self.flights + self.levels,
        )
        estimate = self.estimate
        return (
            plain
            if estimate is None
            else replace(
                plain, probability=estimate.probability, low=estimate.low, high=estimate.high
            )
        )


def estimate_switched(
    evaluate: EvaluateSwitched,
    probabilities: Floats,
    plan: SubsetPlan,
    target_cov: float = 0.2,
    flights: int = 20000,
) -> tuple[RareEstimate, tuple[Stratum, ...]]:
    """Return P(severity > threshold), and the contribution of each combination of switches.

    `probabilities` contains the probability that each switch is active. `evaluate` takes standard
    normal points [point, dimension] and a mask of active switches [point, switch], and returns
    severities [point]. Pilot flights are simulated for all combinations. The most probable
    combination is estimated by subset simulation unless plain flights are enough; the remaining
    flights go to the combination with the largest product of weight and interval width. The
    returned estimate contains the repetitions of this subset simulation.
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

    def fly_plainly(which: list[_Sampler], number: int) -> None:
        points, on = zip(*(sampler.draw(number, plan) for sampler in which), strict=True)
        failed = fly(np.concatenate(points), np.concatenate(on)) > plan.threshold
        for sampler, failures in zip(
            which, failed.reshape(len(which), number).sum(axis=1), strict=True
        ):
            sampler.flights += number
            sampler.failures += int(failures)

    samplers = _list_samplers(probabilities)
    fly_plainly(
        samplers, int(np.clip(flights // (2 * len(samplers)), LANES, _PILOT)) // LANES * LANES
    )
    main, seen = samplers[0], sum(sampler.stratum().value for sampler in samplers)
    # number of flights without failures after which the most probable combination contributes
    # little compared with the pilot estimate of the total
    enough = 3.7 * main.stratum().weight / (_SHARE_OF_COV * target_cov * seen) if seen else np.inf
    budget = min(int(_MAIN_SHARE * flights), flights - used)
    main_estimate: RareEstimate | None = None
    if main.failures < _FEWEST_FAILURES and enough > _MOST_PLAIN and budget >= FEWEST * plan.size:
        main_estimate = estimate_rare(
            lambda u: fly(u, main.rows.repeat(len(u), axis=0)), plan, target_cov, budget
        )
        main.estimate = main_estimate if main_estimate.refusal is None else None
        # If the estimate is rejected, only the flights of its first levels count as plain flights.
        failures, number = (0, 0) if main.estimate else main_estimate.plain
        main.flights += number
        main.failures += failures
        main.levels = main_estimate.flights - number
    while flights - used >= LANES:
        plain = [sampler for sampler in samplers if sampler.estimate is None]
        below, above = _ends([sampler.stratum() for sampler in plain])
        if below + above <= _SHARE_OF_COV * 3.92 * target_cov * sum(
            sampler.stratum().value for sampler in samplers
        ):
            break
        widest = max(plain, key=lambda sampler: sum(_ends([sampler.stratum()])))
        fly_plainly([widest], min(widest.flights, _MOST_AT_ONCE, flights - used) // LANES * LANES)
    strata = tuple(sampler.stratum() for sampler in samplers)
    return _join(strata, main_estimate, used), strata


def _list_samplers(probabilities: Floats) -> list[_Sampler]:
    """Return the most probable combinations one by one, and all others as one stratum."""
    listed = list_combinations(probabilities)
    weights = np.array([weight for _, weight in listed])
    rows = np.array([np.isin(np.arange(len(probabilities)), on) for on, _ in listed])
    samplers = [
        _Sampler(on, rows[[i]], weights[[i]], i)
        for i, (on, _) in enumerate(listed[:MOST_COMBINATIONS])
    ]
    if len(remainder := weights[MOST_COMBINATIONS:]):
        remainder *= (
            1.0 - weights[:MOST_COMBINATIONS].sum()
            # The remainder includes the probability of combinations that are not listed.
        ) / remainder.sum()
        samplers.append(_Sampler(None, rows[MOST_COMBINATIONS:], remainder, len(samplers)))
    return samplers


def _ends(strata: Sequence[Stratum]) -> tuple[float, float]:
    """Return the distances from the sum to the lower and upper bounds of its interval.

    If none of the n_i flights of each stratum i failed, -sum n_i log(1 - p_i) has a joint upper
    bound. The sum of weight times p_i is then bounded by the largest possible contribution of a
    single stratum.
    """
    below = [stratum.weight * (stratum.probability - stratum.low) for stratum in strata]
    above = [
        stratum.weight * (stratum.high - stratum.probability)
        for stratum in strata
        if stratum.probability > 0.0
    ]
    clean = [
        -stratum.weight * np.log1p(-stratum.high)
        for stratum in strata
        if stratum.probability == 0.0
    ]
    return float(np.linalg.norm(below)), float(np.linalg.norm([*above, max(clean, default=0.0)]))


def _join(strata: Sequence[Stratum], main: RareEstimate | None, used: int) -> RareEstimate:
    """Return the sum over all combinations, with its interval."""
    total = sum(stratum.value for stratum in strata)
    below, above = _ends(strata)
    low, high = max(0.0, total - below), min(1.0, total + above)
    refusal = None
    if total == 0.0 or high > 10.0 * low:
        refusal = f"the interval over all combinations extends from {low:.1g} to {high:.1g}"
        if main and main.refusal:
            refusal += f"; for the most probable combination, {main.refusal}"
    cov = (high - low) / (3.92 * total) if total > 0.0 else np.inf
    repetitions, check = (main.repetitions, main.check) if main else ((), None)
    return RareEstimate(
        probability=total,
        low=low,
        high=high,
        cov=cov,
        flights=used,
        repetitions=repetitions,
        check=check,
        refusal=refusal,
    )
