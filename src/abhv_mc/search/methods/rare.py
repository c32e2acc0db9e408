"""Rare-event probability with an interval, or the reason why the estimate is not valid.

The logarithms of the estimates from independent repetitions of subset simulation are approximately
normal. Student's interval of their mean is centred on the logarithm of the mean estimate. The
estimate is rejected if the repetitions contradict each other (a repetition does not reach the
event, the estimates differ by far more than their Markov chains explain, or the interval spans
decades) or if importance sampling disagrees. The upper bound of the interval is the larger of the
two methods' upper bounds.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import LANES, Evaluate, round_up
from abhv_mc.search.methods.second_opinion import (
    LOOK_FLIGHTS,
    MOST_LOOKED,
    MOST_SAMPLED,
    ImportanceEstimate,
    find_failures,
    sample_importance,
)
from abhv_mc.search.methods.subset import Repetition, SubsetPlan, run_subset
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.ranks import standard_ranks

CONFIDENCE = 0.95
FEWEST = 4  # minimum number of repetitions for an estimate
_WIDEST = 10.0  # largest valid ratio of the upper to the lower bound of an interval
# weight of the spread estimated from the Markov chains, as an equivalent number of repetitions
_PRIOR = 4
# The spread of the repetitions is 1 to 1.5 times the spread estimated from their Markov chains
# (benchmarks/rare_coverage.py).
_BEYOND_CHAINS = 1.3
_MOST_BEYOND = 2.0
_CHECK_SHARE = 0.1  # share of the flights that is reserved for importance sampling
# minimum effective number of failures for which importance sampling can raise the upper bound
_SEEN = 8.0
_ENOUGH = 30.0  # minimum effective number of failures for replacing a smaller estimate
EXPECTED = 100.0  # minimum effective number of failures to reject a larger estimate
_HEAVY = 1.5  # factor on the standard error, because most samples miss the largest weights
_FEWEST_CHECKED = 256  # minimum number of flights for importance sampling
_SHARE_OF_LANES = 10_000  # number of available flights for every LANES chains of a repetition


def choose_chains(flights: int) -> int:
    """Return the number of chains with which four repetitions reach probabilities of 1e-7."""
    return LANES * int(np.clip(flights // _SHARE_OF_LANES, 1, 8))


@dataclass(frozen=True)
class RareEstimate:
    """Estimate from repetitions of subset simulation."""

    probability: float  # mean over the repetitions
    low: float
    high: float
    cov: float  # coefficient of variation of the mean, computed from the spread of the repetitions
    flights: int
    repetitions: tuple[Repetition, ...]
    check: ImportanceEstimate | None
    refusal: str | None  # reason why the estimate cannot be trusted; None if it can

    @property
    def failures(self) -> Floats:
        """Failures [point, dimension] in all repetitions, a sample of the failure distribution."""
        return (
            np.concatenate([repetition.failures for repetition in self.repetitions])
            if self.repetitions
            else np.empty((0, 0))
        )

    @property
    def plain(self) -> tuple[int, int]:
        """Failure and flight counts of the first levels, which are plain Monte Carlo samples."""
        return sum(repetition.plain_failures for repetition in self.repetitions), sum(
            len(repetition.points) for repetition in self.repetitions
        )

    @property
    def unwarned_high(self) -> float | None:
        """One-sided 95 % upper bound on the probability of failures without warning.

        The bound is computed from the plain flights; it is None if there are none.
        """
        return clopper_pearson(*self.plain, 2.0 * CONFIDENCE - 1.0)[1] if self.plain[1] else None

    def include_unwarned(self) -> "RareEstimate":
        """Return the estimate with an interval that includes failures without warning."""
        return replace(self, high=max(self.high, self.unwarned_high or 0.0))


def estimate_rare(
    evaluate: Evaluate, plan: SubsetPlan, target_cov: float = 0.2, flights: int = 20000
) -> RareEstimate:
    """Return P(severity > threshold) for standard normal points, with a 95 % interval.

    The first repetitions run in parallel; more are added until the interval is as narrow as that of
    a normally distributed estimate with the coefficient of variation `target_cov`, or until another
    repetition would exceed `flights`. Severities may depend on additional random numbers that are
    drawn for each point. `flights` must be enough for the first levels of `FEWEST` repetitions.
    """
    check_flights = round_up(int(_CHECK_SHARE * flights)) if plan.dimension <= MOST_SAMPLED else 0
    if plan.dimension <= MOST_LOOKED:
        check_flights += LOOK_FLIGHTS
    used = 0

    def counted(points: Floats) -> Floats:
        nonlocal used
        used += len(points)
        return evaluate(points)

    repetitions = run_subset(counted, plan, range(FEWEST), flights, FEWEST)
    number = FEWEST
    while added := _count_more(repetitions, flights - check_flights - used, target_cov):
        repetitions += run_subset(
            counted, plan, range(number, number + added), flights - check_flights - used
        )
        number += added
    refusal = _judge(repetitions)
    probability, low, high, cov = _interval(repetitions)
    check = None
    check_flights = min(check_flights, (flights - used) // LANES * LANES)
    if refusal is None and check_flights >= _FEWEST_CHECKED:
        failures = np.concatenate([repetition.failures for repetition in repetitions])
        if plan.dimension <= MOST_LOOKED and check_flights >= _FEWEST_CHECKED + LOOK_FLIGHTS:
            again = find_failures(counted, plan.dimension, plan.threshold, probability, plan.seed)
            failures = np.concatenate([failures, again])
            check_flights -= LOOK_FLIGHTS
        check = sample_importance(counted, plan.threshold, failures, check_flights, plan.seed)
    if check is not None and check.effective >= _SEEN:
        log_ratio, deviation = np.log(check.probability / probability), _HEAVY * check.cov
        factor = np.exp(stats.norm.ppf(0.5 + CONFIDENCE / 2.0) * deviation)
        contradicts = abs(log_ratio) > 3.0 * np.hypot(check.cov, np.log(high / low) / 3.92)
        if (
            contradicts and log_ratio > 0.0 and check.effective >= _ENOUGH
        ):  # Importance sampling may cover a failure region that subset simulation misses.
            probability, low, cov = check.probability, check.probability / factor, deviation
        elif contradicts and (
            log_ratio > 0.0 or check.effective >= EXPECTED
        ):  # A smaller value contradicts the estimate only if enough failures support it.
            refusal = (
                f"importance sampling gives {check.probability:.2g}, but subset simulation gives "
                f"{probability:.2g}"
            )
        high = max(high, min(1.0, check.probability * factor))
    return RareEstimate(
        probability=probability,
        low=low,
        high=high,
        cov=cov,
        flights=used,
        repetitions=tuple(repetitions),
        check=check,
        refusal=refusal,
    )


def noise_share(severities: tuple[Floats, Floats]) -> float:
    """Return the share of the variance of the severity ranks that is due to noise.

    Both arrays contain severities [point] at the same points with different random numbers.
    """
    first, second = np.split(standard_ranks(np.concatenate(severities)), 2)
    return min(1.0, float(np.mean((first - second) ** 2)) / 2.0)


def _half_width(repetitions: list[Repetition], number: int) -> float:
    """Return the half-width of the interval of the log probability for `number` repetitions.

    The variance combines the spread of the repetitions with the spread estimated from their Markov
    chains. The latter has the larger weight, because the spread of few repetitions is inaccurate.
    """
    logs = np.log([repetition.probability for repetition in repetitions])
    chains = (_BEYOND_CHAINS * _chain_cov(repetitions)) ** 2
    own = len(logs) - 1
    variance = (_PRIOR * chains + own * logs.var(ddof=1)) / (_PRIOR + own)
    return float(
        stats.t.ppf(0.5 + CONFIDENCE / 2.0, _PRIOR + number - 1) * np.sqrt(variance / number)
    )


def _chain_cov(repetitions: list[Repetition]) -> float:
    """Return the coefficient of variation of one repetition, estimated from Markov chains."""
    return float(np.sqrt(np.mean([repetition.cov**2 for repetition in repetitions])))


def _count_more(repetitions: list[Repetition], left: int, target_cov: float) -> int:
    """Return the number of further repetitions that are needed and for which flights are left."""
    if not all(repetition.reached for repetition in repetitions):
        return 0
    wide = stats.norm.ppf(0.5 + CONFIDENCE / 2.0) * target_cov
    fitting = left // max(repetition.flights for repetition in repetitions)
    expected, number = 0, len(repetitions)
    while expected < fitting and _half_width(repetitions, number + expected) > wide:
        expected += 1
    return expected


def _interval(repetitions: list[Repetition]) -> tuple[float, float, float, float]:
    """Return the mean, its interval (0 .. 1 if undefined) and its coefficient of variation."""
    estimates = np.array([repetition.probability for repetition in repetitions])
    number = len(estimates)
    mean = float(estimates.mean())
    if not np.all(estimates > 0.0):
        return mean, 0.0, 1.0, np.inf
    half = _half_width(repetitions, number)
    cov = float(estimates.std(ddof=1) / (mean * np.sqrt(number)))
    return mean, float(mean * np.exp(-half)), float(min(1.0, mean * np.exp(half))), cov


def _judge(repetitions: list[Repetition]) -> str | None:
    """Return the reason why the repetitions cannot be trusted, or None if they can."""
    number = len(repetitions)
    missed = sum(not repetition.reached for repetition in repetitions)
    deepest = min(
        float(np.prod([level.probability for level in repetition.levels]))
        for repetition in repetitions
    )
    if any(repetition.cut_short for repetition in repetitions):
        finished = f"only {number - missed}" if number > missed else "none"
        return (
            f"{finished} of the {number} repetitions had enough flights; the smallest probability "
            f"reached is {deepest:.1g}"
        )
    if missed == number:
        return (
            f"no repetition reaches the event, which is rarer than {deepest:.1g} or lies on a "
            "plateau of the severity"
        )
    if missed:
        verb = "does" if missed == 1 else "do"
        return f"{missed} of {number} repetitions {verb} not reach the event"
    logs = np.log([repetition.probability for repetition in repetitions])
    _, low, high, _ = _interval(repetitions)
    if high > _WIDEST * low:
        return (
            f"the estimates of the repetitions range from {np.exp(logs.min()):.1g} to "
            f"{np.exp(logs.max()):.1g}"
        )
    ratio = float(logs.std(ddof=1)) / _chain_cov(repetitions)
    if ratio**2 * (number - 1) > _MOST_BEYOND**2 * stats.chi2.isf(1e-3, number - 1):
        return f"the repetitions differ {ratio:.1f} times as much as their Markov chains explain"
    return None
