"""Subset simulation: a rare-event probability as a product of conditional probabilities.

S.K. Au, J.L. Beck, "Estimation of small failure probabilities in high dimensions by subset
simulation", Probabilistic Engineering Mechanics 16 (2001); the chains are moved by adaptive
conditional sampling: I. Papaioannou, W. Betz, K. Zwirglmaier, D. Straub, "MCMC algorithms for
subset simulation", Probabilistic Engineering Mechanics 41 (2015).

Points are independent standard normal numbers. Independent repetitions run in parallel: each batch
contains one step of all chains of all repetitions.
"""

from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import Evaluate, make_generator

# number of points per chain; the most severe tenth of a level's points starts the next level
_LENGTH = 10
_MOST_LEVELS = 12
ACCEPTANCE = 0.44  # optimal acceptance rate for these chains (Papaioannou et al., section 4)


@dataclass(frozen=True)
class Level:
    """Level in one repetition of subset simulation."""

    # severity at which the next level begins; at the last level, the limit of the requirement
    threshold: float
    probability: float  # share of the level's points at or above the threshold
    cov: float  # coefficient of variation of the share, including the correlation of the chains
    acceptance: float  # share of accepted moves; 1 at the first level, which is a plain sample
    # standard deviation of a proposal about its mean (1: independent of the present point)
    spread: float


@dataclass
class Repetition:
    """State of one independent subset simulation."""

    number: int
    points: Floats  # points of the present level [point, dimension], in blocks [step, chain]
    values: Floats  # severity of each point [point]
    flights: int  # number of evaluations so far
    plain_failures: int  # number of failures in the first level, which is a plain sample
    levels: list[Level] = field(default_factory=list)
    scale: float = 0.6  # parameter lambda of the adaptation; Papaioannou et al. start with 0.6
    acceptance: float = 1.0
    spread: float = 1.0
    reached: bool = False  # whether enough failures were found
    cut_short: bool = False  # whether there were too few flights for the next level

    @property
    def probability(self) -> float:
        """Product of the levels' probabilities; 0 if the event was not reached."""
        return float(np.prod([level.probability for level in self.levels])) if self.reached else 0.0

    @property
    def failures(self) -> Floats:
        """Failures [point, dimension] in the last level; rejected moves repeat a point."""
        return (
            self.points[self.values > self.levels[-1].threshold]
            if self.reached
            else self.points[:0]
        )

    @property
    def cov(self) -> float:
        """Coefficient of variation for independent levels (lower bound of Au & Beck)."""
        return float(np.sqrt(np.sum([level.cov**2 for level in self.levels])))


@dataclass(frozen=True)
class SubsetPlan:
    """Settings common to all repetitions."""

    dimension: int
    threshold: float  # severity above which a flight fails
    seed: int
    chains: int = 64  # number of chains of each level and repetition, a multiple of LANES

    @property
    def size(self) -> int:
        """Number of points per level."""
        return self.chains * _LENGTH


def run_subset(
    evaluate: Evaluate, plan: SubsetPlan, numbers: range, flights: int, fewest: int = 0
) -> list[Repetition]:
    """Return the repetitions with these `numbers`, which estimate P(severity > threshold).

    If `flights` do not suffice for another level of all repetitions, the repetitions with the
    largest numbers are dropped whatever their results, so that the selection is unbiased. If fewer
    than `fewest` would remain, all repetitions end, and unfinished repetitions are marked
    `cut_short`. `reached` is False for a repetition without enough failures at the last level, or
    on a plateau of equal severities.
    """
    size = plan.size
    drawn = [
        make_generator(plan.seed, number, 0).standard_normal((size, plan.dimension))
        for number in numbers
    ]
    values = evaluate(np.concatenate(drawn)).reshape(len(drawn), size)
    failed = (values > plan.threshold).sum(axis=1)
    repetitions = [
        Repetition(n, drawn[i], values[i], size, int(failed[i])) for i, n in enumerate(numbers)
    ]
    left, cost = flights - size * len(repetitions), size - plan.chains
    active = repetitions
    for level in range(1, _MOST_LEVELS + 1):
        active = [repetition for repetition in active if not _close_level(repetition, plan)]
        while cost * len(active) > left:
            if len(repetitions) <= fewest:
                for repetition in active:
                    repetition.cut_short = True
                return repetitions
            dropped = repetitions.pop()
            active = [repetition for repetition in active if repetition is not dropped]
        if not active or level == _MOST_LEVELS:
            break
        _move_chains(evaluate, active, plan, level)
        left -= cost * len(active)
    return repetitions


def _close_level(repetition: Repetition, plan: SubsetPlan) -> bool:
    """Set the level's threshold and probability; return whether this was the last level."""
    size, chains, threshold = plan.size, plan.chains, plan.threshold
    limit = float(np.partition(repetition.values, size - chains)[size - chains])
    last = limit > threshold
    inside = repetition.values > threshold if last else repetition.values >= limit
    correlated = _chain_inflation(inside, chains) if repetition.levels else 1.0
    share = float(inside.mean())
    cov = float(np.sqrt((1.0 - share) / (share * size) * correlated))
    repetition.levels.append(
        Level(threshold if last else limit, share, cov, repetition.acceptance, repetition.spread)
    )
    repetition.reached = last
    return last or bool(inside.all())


def _chain_inflation(inside: np.ndarray, chains: int) -> float:
    """Return the factor by which the chains' correlation increases the variance of a share.

    The factor is 1 + gamma of Au & Beck.
    """
    # mask of failures [step, chain]
    table = inside.reshape(-1, chains).astype(np.float64)
    length = len(table)
    share = table.mean()
    variance = share * (1.0 - share)
    if variance == 0.0:
        return 1.0
    lags = np.arange(1, length)
    products = np.array([np.mean(table[lag:] * table[:-lag]) - share**2 for lag in lags])
    return float(max(1.0, 1.0 + 2.0 * np.sum((1.0 - lags / length) * products / variance)))


def _move_chains(
    evaluate: Evaluate, active: list[Repetition], plan: SubsetPlan, level: int
) -> None:
    """Replace each repetition's points with chains from its points beyond the threshold."""
    seed, chains = plan.seed, plan.chains
    limits, histories, accepted = [], [], []
    for repetition in active:
        limit = repetition.levels[-1].threshold
        inside = np.flatnonzero(repetition.values >= limit)
        seeds = make_generator(seed, repetition.number, level, 0).permutation(inside)[:chains]
        histories.append([(repetition.points[seeds], repetition.values[seeds])])
        limits.append(limit)
        accepted.append(0.0)
    for step in range(1, _LENGTH):
        proposals = []
        for repetition, history in zip(active, histories, strict=True):
            # All dimensions have the same spread: with separate spreads, the probabilities were 1.9
            # times too high in 100 dimensions.
            repetition.spread = min(1.0, repetition.scale)
            noise = make_generator(seed, repetition.number, level, step).standard_normal(
                history[-1][0].shape
            )
            proposals.append(
                np.sqrt(1.0 - repetition.spread**2) * history[-1][0] + repetition.spread * noise
            )
        proposed_values = evaluate(np.concatenate(proposals)).reshape(len(active), chains)
        for i, repetition in enumerate(active):
            better = proposed_values[i] >= limits[i]
            points, values = histories[i][-1]
            histories[i].append(
                (
                    np.where(better[:, None], proposals[i], points),
                    np.where(better, proposed_values[i], values),
                )
            )
            rate = float(better.mean())
            accepted[i] += rate / (_LENGTH - 1)
            repetition.scale = float(
                np.clip(repetition.scale * np.exp((rate - ACCEPTANCE) / np.sqrt(step)), 1e-3, 10.0)
            )
    for i, repetition in enumerate(active):
        repetition.points = np.concatenate([points for points, _ in histories[i]])
        repetition.values = np.concatenate([values for _, values in histories[i]])
        repetition.flights += chains * (_LENGTH - 1)
        repetition.acceptance = accepted[i]
