"""Minimization of an objective under constraints with CMA-ES.

All candidates are scored with the same random numbers, so that their differences are not due to
chance. CMA-ES needs only the order of candidates: feasible candidates come first, ordered by
objective, and infeasible candidates follow, ordered by constraint violation (K. Deb, "An efficient
constraint handling method for genetic algorithms", Computer Methods in Applied Mechanics and
Engineering 186 (2000)). A search overfits its flights, so the best candidate must be compared with
the initial one on other flights.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import make_generator

_POPULATION = 16  # number of candidates of a generation
_STALE = 15  # number of generations without improvement before a restart at the best candidate
_SMALL = 0.3  # step after a restart, relative to the initial step


class Scores(NamedTuple):
    """Scores of candidates on common flights, infinite for invalid candidates."""

    objective: Floats  # objective [candidate], to be minimized
    # excess over each limit [candidate, limit]; a positive value is a relative violation
    excess: Floats
    usage: Floats  # control effort [candidate], the second objective

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Mask [candidate] of candidates that violate no limit."""
        return np.isfinite(self.objective) & np.all(self.excess <= 0.0, axis=1)

    def rank(self) -> NDArray[np.intp]:
        """Return the rank [candidate], 0 for the best; equal candidates share a rank."""
        broken = np.where(np.isfinite(self.excess), np.maximum(self.excess, 0.0), np.inf).sum(
            axis=1
        )
        broken = np.where(np.isfinite(self.objective), broken, np.inf)
        within = np.where(self.allowed, self.objective, 0.0)
        pairs = np.column_stack([broken, within])
        _, ranks = np.unique(pairs, axis=0, return_inverse=True)
        return ranks.reshape(-1)


@dataclass(frozen=True)
class Tuning:
    """Result of a search: all candidates, and the best candidate."""

    best: int  # index of the best candidate; the start is candidate 0
    points: Floats  # coordinates [candidate, dimension] in the box from -1 to 1
    scores: Scores

    @property
    def best_point(self) -> Floats:
        """Coordinates [dimension] of the best candidate."""
        return self.points[self.best]

    @property
    def front(self) -> NDArray[np.intp]:
        """Indices of feasible candidates on the Pareto front of objective and control effort."""
        allowed = np.flatnonzero(self.scores.allowed)
        return allowed[
            pareto_front(np.column_stack([self.scores.usage, self.scores.objective])[allowed])
        ]


def pareto_front(costs: Floats) -> NDArray[np.intp]:
    """Return the nondominated rows of ``costs`` [candidate, 2], sorted by the first column."""
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    lowest = np.minimum.accumulate(np.append(np.inf, costs[order, 1]))[:-1]
    return order[costs[order, 1] < lowest]


def tune(
    measure: Callable[[Floats], Scores],
    start: Floats,
    candidates: int,
    seed: int = 0,
    step: float = 0.25,
) -> Tuning:
    """Search the box from -1 to 1, starting at ``start`` [dimension].

    ``measure`` scores points [candidate, dimension]; at most ``candidates`` are scored, including
    the start. ``step`` is the initial standard deviation.
    """
    from cmaes import CMA

    dimension = len(start)
    points = start[None, :]
    scores = measure(points)
    # CMA-ES needs at least two dimensions, so a dummy dimension is added if there is only one.
    bounds = np.tile([-1.0, 1.0], (max(dimension, 2), 1))
    cma: CMA | None = None
    starts = 0
    stale = 0
    best = 0
    while len(points) + _POPULATION <= candidates:
        if cma is None or cma.should_stop() or stale >= _STALE:
            mean = np.zeros(len(bounds))
            mean[:dimension] = points[best]
            number = int(make_generator(seed, starts).integers(2**32))
            sigma = step if starts == 0 else step * _SMALL
            cma = CMA(
                mean, sigma, bounds, n_max_resampling=1, seed=number, population_size=_POPULATION
            )
            starts = starts + 1
            stale = 0
        generation = np.array([cma.ask() for _ in range(_POPULATION)])
        new_scores = measure(generation[:, :dimension])
        cma.tell(list(zip(generation, new_scores.rank().astype(float).tolist(), strict=True)))
        points = np.concatenate([points, generation[:, :dimension]])
        scores = Scores(*map(np.concatenate, zip(scores, new_scores, strict=True)))
        best, before = int(np.argmin(scores.rank())), best
        stale = stale + 1 if best == before else 0
    return Tuning(best, points, scores)
