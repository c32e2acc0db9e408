"""Subset simulation: a rare event as a product of frequent ones, each given the one before.

S.K. Au, J.L. Beck, "Estimation of small failure probabilities in high dimensions by subset simulation", Probabilistic
Engineering Mechanics 16 (2001); the chains are moved by adaptive conditional sampling: I. Papaioannou, W. Betz,
K. Zwirglmaier, D. Straub, "MCMC algorithms for subset simulation", Probabilistic Engineering Mechanics 41 (2015).

Points are independent standard normal numbers. Several repetitions, independent of each other, run side by side so
that each batch holds one step of all chains of all repetitions.
"""

from dataclasses import dataclass, field

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import Evaluate, make_generator

_LENGTH = (
    10  # points of a chain, its first among them: a tenth of a level's points start the next level
)
_MOST_LEVELS = 12
ACCEPTANCE = 0.44  # optimal for these chains: Papaioannou et al., section 4


@dataclass(frozen=True)
class Level:
    """One level of one repetition."""

    threshold: float  # severity from which on a point belongs to the next level; the last level's is the requirement's
    probability: float  # share of this level's points at or above it
    cov: float  # coefficient of variation of that share, the chains' correlation included
    acceptance: float  # share of accepted moves; 1 at the first level, which is drawn freely
    spread: float  # standard deviation of a proposal about its own mean (1: drawn afresh)


@dataclass
class Repetition:
    """One independent subset simulation as it goes."""

    number: int
    points: (
        Floats  # [point, dimension] of the present level, chain by chain in blocks: [step, chain]
    )
    values: Floats  # [point]
    flights: int  # evaluated for it so far
    plain_failures: int  # among its first level, which is drawn freely
    levels: list[Level] = field(default_factory=list)
    scale: float = 0.6  # lambda of the adaptation; 0.6 is where Papaioannou et al. start
    acceptance: float = 1.0
    spread: float = 1.0
    reached: bool = False  # whether failures were found in sufficient number
    cut_short: bool = False  # whether the flights did not suffice for its next level

    @property
    def probability(self) -> float:
        """Product of the levels' probabilities; 0 where the last level was not reached."""
        return float(np.prod([level.probability for level in self.levels])) if self.reached else 0.0

    @property
    def failures(self) -> Floats:
        """The failures ``[point, dimension]`` of the last level, a point once for every move that stayed there."""
        return (
            self.points[self.values > self.levels[-1].threshold]
            if self.reached
            else self.points[:0]
        )

    @property
    def cov(self) -> float:
        """Coefficient of variation as the levels' own, taken as independent (Au & Beck's lower bound)."""
        return float(np.sqrt(np.sum([level.cov**2 for level in self.levels])))


@dataclass(frozen=True)
class SubsetPlan:
    """What every repetition has in common."""

    dimension: int
    threshold: float  # a severity above it is a failure
    seed: int
    chains: int = 64  # of each level and repetition: whole lanes

    @property
    def size(self) -> int:
        """Points of a level."""
        return self.chains * _LENGTH


def run_subset(
    evaluate: Evaluate, plan: SubsetPlan, numbers: range, flights: int, fewest: int = 0
) -> list[Repetition]:
    """The repetitions ``numbers`` of a subset simulation for P(severity > threshold).

    Where ``flights`` do not suffice for another level of all, the last ones by number are given up and not returned,
    whatever they have found: which ones are kept must not depend on their results. Where that would leave fewer than
    ``fewest``, all end there, those that are not done as cut short. A repetition that has not met
    enough failures at the last level, or meets a plateau on which no point is more severe than another, has
    ``reached`` False.
    """
    size = plan.size
    drawn = [
        make_generator(plan.seed, number, 0).standard_normal((size, plan.dimension))
        for number in numbers
    ]
    values = evaluate(np.concatenate(drawn)).reshape(len(drawn), size)
    failed = (values > plan.threshold).sum(axis=1)
    kept = [Repetition(n, drawn[i], values[i], size, int(failed[i])) for i, n in enumerate(numbers)]
    left, cost = flights - size * len(kept), size - plan.chains
    active = kept
    for level in range(1, _MOST_LEVELS + 1):
        active = [one for one in active if not _close_level(one, plan)]
        while cost * len(active) > left:
            if len(kept) <= fewest:
                for one in active:
                    one.cut_short = True
                return kept
            dropped = kept.pop()
            active = [one for one in active if one is not dropped]
        if not active or level == _MOST_LEVELS:
            break
        _move_chains(evaluate, active, plan, level)
        left -= cost * len(active)
    return kept


def _close_level(one: Repetition, plan: SubsetPlan) -> bool:
    """Choose the level's threshold and note its probability; whether this was the repetition's last level."""
    size, chains, threshold = plan.size, plan.chains, plan.threshold
    limit = float(np.partition(one.values, size - chains)[size - chains])
    last = limit > threshold
    inside = one.values > threshold if last else one.values >= limit
    correlated = _chain_inflation(inside, chains) if one.levels else 1.0
    share = float(inside.mean())
    cov = float(np.sqrt((1.0 - share) / (share * size) * correlated))
    one.levels.append(Level(threshold if last else limit, share, cov, one.acceptance, one.spread))
    one.reached = last
    return last or bool(inside.all())


def _chain_inflation(inside: np.ndarray, chains: int) -> float:
    """Factor of the variance of a level's share that its chains' correlation makes: 1 + gamma of Au & Beck."""
    table = inside.reshape(-1, chains).astype(np.float64)  # [step, chain]
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
    """Replace the points of each repetition by chains that start in its points beyond the last threshold."""
    seed, chains = plan.seed, plan.chains
    limits, histories, accepted = [], [], []
    for one in active:
        limit = one.levels[-1].threshold
        inside = np.flatnonzero(one.values >= limit)
        seeds = make_generator(seed, one.number, level, 0).permutation(inside)[:chains]
        histories.append([(one.points[seeds], one.values[seeds])])
        limits.append(limit)
        accepted.append(0.0)
    for step in range(1, _LENGTH):
        proposals = []
        for one, history in zip(active, histories, strict=True):
            # One for all dimensions: those of the seeds, 64 points, made it 1.9 times too high at dimension 100.
            one.spread = min(1.0, one.scale)
            noise = make_generator(seed, one.number, level, step).standard_normal(
                history[-1][0].shape
            )
            proposals.append(np.sqrt(1.0 - one.spread**2) * history[-1][0] + one.spread * noise)
        found = evaluate(np.concatenate(proposals)).reshape(len(active), chains)
        for i, one in enumerate(active):
            better = found[i] >= limits[i]
            points, values = histories[i][-1]
            histories[i].append(
                (
                    np.where(better[:, None], proposals[i], points),
                    np.where(better, found[i], values),
                )
            )
            rate = float(better.mean())
            accepted[i] += rate / (_LENGTH - 1)
            one.scale = float(
                np.clip(one.scale * np.exp((rate - ACCEPTANCE) / np.sqrt(step)), 1e-3, 10.0)
            )
    for i, one in enumerate(active):
        one.points = np.concatenate([points for points, _ in histories[i]])
        one.values = np.concatenate([values for _, values in histories[i]])
        one.flights += chains * (_LENGTH - 1)
        one.acceptance = accepted[i]
