"""Search for the largest value in a box: first points, then CMA-ES, then a local search.

CMA-ES: N. Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies",
Evolutionary Computation 9 (2001), as in the package cmaes. Several optimizers run in parallel from
different starts; a converged optimizer is replaced by one that starts at the best point far from
all previous starts.
"""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import (
    LANES,
    Evaluate,
    Progress,
    Record,
    make_generator,
    round_up,
)
from abhv_mc.search.methods.first_points import explore
from abhv_mc.search.methods.polish import polish

_BATCHES = 15  # minimum number of batches, because a search learns only between batches
_MOST_IN_BATCH = 512
_POLISH_SHARE = 0.25  # share of the evaluations for the final local search
_STEP = 0.3  # initial standard deviation of CMA-ES, in half widths of the box
_APART = 0.2  # minimum rms distance between starts
_STALE = 10  # number of generations without improvement after which an optimizer restarts elsewhere
_PROBE = 0.1  # step of the sensitivities at the worst point, in half widths of the box
AT_BOUND = 1.0 - 1e-9


@dataclass(frozen=True)
class WorstCase:
    """Largest value found in the box -1 .. 1."""

    value: float
    place: Floats  # coordinates of the largest value [dimension]
    history: tuple[Progress, ...]
    # change of the value if a coordinate is lower or higher [dimension, 2]; NaN outside the box
    sensitivity: Floats
    points: Floats  # evaluated points [evaluation, dimension]
    values: Floats  # values of the points [evaluation]

    @property
    def at_bounds(self) -> np.ndarray:
        """Mask [dimension] of coordinates at a bound, except those without influence."""
        idle = np.isfinite(self.sensitivity).any(axis=1) & (
            np.nan_to_num(self.sensitivity) == 0.0
        ).all(axis=1)
        return (np.abs(self.place) >= AT_BOUND) & ~idle


def _choose_batch(evaluations: int) -> int:
    """Return the batch size, which grows with the number of evaluations."""
    return (
        int(np.clip(evaluations // _BATCHES // (2 * LANES), 1, _MOST_IN_BATCH // (2 * LANES)))
        * 2
        * LANES
    )


def least_evaluations(dimension: int, evaluations: int) -> int:
    """Return the minimum number of evaluations that :func:`search_worst` needs.

    The batch size follows from `evaluations`.
    """
    return 2 * round_up(2 * dimension + 1, _choose_batch(evaluations)) + round_up(2 * dimension)


def search_worst(
    evaluate: Evaluate, dimension: int, evaluations: int = 2000, seed: int = 0
) -> WorstCase:
    """Search the box -1 .. 1 for the largest value with at most `evaluations` evaluations.

    At least :func:`least_evaluations` are needed.
    """
    batch = _choose_batch(evaluations)
    reserve = round_up(2 * dimension)
    record = Record(evaluate, evaluations)
    explore(record, dimension, seed, batch)
    step = _evolve(
        record, dimension, seed, batch, max(int(_POLISH_SHARE * evaluations), reserve + 2 * batch)
    )
    polish(record, step, seed, batch, reserve)
    sensitivity = _probe(record, dimension, reserve)
    return WorstCase(
        record.best,
        record.place,
        tuple(record.history),
        sensitivity,
        np.concatenate(record.points),
        np.concatenate(record.values),
    )


def _evolve(record: Record, dimension: int, seed: int, batch: int, reserve: int) -> float:
    """Run CMA-ES until `reserve` evaluations are left; return the step of the local search."""
    from cmaes import CMA

    # CMA-ES needs at least two dimensions; in one dimension, the evenly spaced first points and the
    # local search suffice.
    if dimension == 1:
        return 4.0 / record.used
    side_by_side = batch // LANES
    bounds = np.tile([-1.0, 1.0], (dimension, 1))
    starts = list(record.best_places(64, _APART))
    # optimizer, its best value, and its generations without improvement
    running: list[tuple[CMA, float, int]] = []
    begun, last = 0, _STEP
    while record.left - reserve >= batch:
        while len(running) < side_by_side:
            start = starts[begun % len(starts)]
            number = int(make_generator(seed, 0, begun).integers(2**32))
            # Points outside the box are redrawn once, then moved to the bound, where many worst
            # cases lie.
            cma = CMA(start, _STEP, bounds, n_max_resampling=1, seed=number, population_size=LANES)
            running.append((cma, -np.inf, 0))
            begun += 1
        proposals = [np.array([cma.ask() for _ in range(LANES)]) for cma, _, _ in running]
        values = record.call(np.concatenate(proposals), "CMA-ES").reshape(side_by_side, LANES)
        going = []
        for (cma, before, age), points, batch_values in zip(
            running, proposals, values, strict=True
        ):
            # CMA-ES needs finite values: replace infinite values by the worst finite value.
            finite = batch_values[np.isfinite(batch_values)]
            losses = -np.where(
                np.isfinite(batch_values), batch_values, finite.min() if finite.size else 0.0
            )
            cma.tell(list(zip(points, losses.tolist(), strict=True)))
            stale = 0 if batch_values.max() > before else age + 1
            if batch_values.max() >= record.best:
                last = float(np.clip(points.std(axis=0).max(), 0.01, _STEP))
            if not cma.should_stop() and stale < _STALE:
                going.append((cma, max(before, float(batch_values.max())), stale))
        running = going
    return last


def _probe(record: Record, dimension: int, reserve: int) -> Floats:
    """Return changes of the value near the best point; a better point replaces it."""
    center, best = record.place, record.best
    probes = np.concatenate(
        [center - _PROBE * np.eye(dimension), center + _PROBE * np.eye(dimension)]
    )
    outside = np.abs(probes).max(axis=1) > 1.0 + 1e-12
    filled = np.concatenate(
        [np.clip(probes, -1.0, 1.0), np.tile(center, (reserve - 2 * dimension, 1))]
    )
    values = record.call(filled, "sensitivity")[: 2 * dimension]
    change = np.where(outside, np.nan, values - best)
    return np.column_stack([change[:dimension], change[dimension:]])
