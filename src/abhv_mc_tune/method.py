"""Better values of free parameters under constraints.

Each candidate is scored on the same random numbers, so that candidates differ by what they are and not by luck. CMA-ES
needs the order of candidates only: those that keep every limit come first, by their objective; the others follow, by
how far they are outside (K. Deb, "An efficient constraint handling method for genetic algorithms", Computer Methods in
Applied Mechanics and Engineering 186 (2000)). A search on one set of flights fits itself to them, so the result is
compared with the start on a fresh set.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import make_generator

_STALE = 15  # generations without a better candidate, after which the search starts again at the best with small steps
_SMALL = 0.3  # of the first step


class Scores(NamedTuple):
    """How candidates do on the common flights; an objective that cannot be computed is infinite."""

    objective: Floats  # [candidate]: to be made small
    excess: Floats  # [candidate, limit]: above zero where a limit is broken, relative to the limit or its scale
    usage: Floats  # [candidate]: what the objective is traded against

    @property
    def allowed(self) -> NDArray[np.bool_]:
        """Candidates ``[candidate]`` that keep every limit."""
        return np.isfinite(self.objective) & np.all(self.excess <= 0.0, axis=1)

    def rank(self) -> NDArray[np.intp]:
        """Place ``[candidate]`` of each in the order from best to worst; equal ones share a place."""
        broken = np.where(np.isfinite(self.excess), np.maximum(self.excess, 0.0), np.inf).sum(
            axis=1
        )
        broken = np.where(np.isfinite(self.objective), broken, np.inf)
        within = np.where(self.allowed, self.objective, 0.0)
        pairs = np.column_stack([broken, within])
        _, place = np.unique(pairs, axis=0, return_inverse=True)
        return place.reshape(-1)


@dataclass(frozen=True)
class Tuning:
    """What a search of free parameters found."""

    best: int  # the best candidate's number; the start is candidate 0
    points: Floats  # [candidate, dimension], box -1 .. 1
    scores: Scores

    @property
    def place(self) -> Floats:
        """The best candidate ``[dimension]``."""
        return self.points[self.best]

    @property
    def front(self) -> NDArray[np.intp]:
        """Candidates that keep every limit and that no other one beats in objective and usage, by their usage."""
        allowed = np.flatnonzero(self.scores.allowed)
        return allowed[
            pareto_front(np.column_stack([self.scores.usage, self.scores.objective])[allowed])
        ]


def pareto_front(costs: Floats) -> NDArray[np.intp]:
    """Rows of ``costs`` [candidate, 2] that no other beats in one and equals or beats in the other, by the first."""
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    lowest = np.minimum.accumulate(np.append(np.inf, costs[order, 1]))[:-1]
    return order[costs[order, 1] < lowest]


def tune(
    measure: Callable[[Floats], Scores],
    start: Floats,
    candidates: int,
    seed: int = 0,
    step: float = 0.25,
    population: int = 16,
) -> Tuning:
    """Search the box -1 .. 1 from ``start`` [dimension] with at most so many candidates, the start among them.

    ``measure`` scores candidates ``[candidate, dimension]``. The step is the first standard deviation.
    """
    from cmaes import CMA

    dimension = len(start)
    points = start[None, :]
    scores = measure(points)
    # CMA-ES wants two dimensions; a single one gets an idle companion.
    bounds = np.tile([-1.0, 1.0], (max(dimension, 2), 1))
    cma: CMA | None = None
    begun, stale, best = 0, 0, 0
    while len(points) + population <= candidates:
        if cma is None or cma.should_stop() or stale >= _STALE:
            mean = np.zeros(max(dimension, 2))
            mean[:dimension] = points[best]
            number = int(make_generator(seed, begun).integers(2**32))
            sigma = step if begun == 0 else step * _SMALL
            cma = CMA(
                mean, sigma, bounds, n_max_resampling=1, seed=number, population_size=population
            )
            begun, stale = begun + 1, 0
        asked = np.array([cma.ask() for _ in range(population)])
        found = measure(asked[:, :dimension])
        cma.tell(list(zip(asked, found.rank().astype(float).tolist(), strict=True)))
        points = np.concatenate([points, asked[:, :dimension]])
        scores = Scores(*map(np.concatenate, zip(scores, found, strict=True)))
        best, before = int(np.argmin(scores.rank())), best
        stale = stale + 1 if best == before else 0
    return Tuning(best, points, scores)
