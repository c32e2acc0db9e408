"""Search for the largest value in a box: first points, then CMA-ES, then a local search.

CMA-ES: N. Hansen, A. Ostermeier, "Completely derandomized self-adaptation in evolution strategies",
Evolutionary Computation 9 (2001), as in the package cmaes. Several optimizers run in parallel from
different starts; a converged optimizer is replaced by one that starts at the best point far from
all previous starts.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.optimize import minimize

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import (
    LANES,
    Evaluate,
    Progress,
    Record,
    make_generator,
    round_up,
)

_BATCHES = 15  # minimum number of batches, because a search learns only between batches
_MOST_IN_BATCH = 512
_POLISH_SHARE = 0.25  # share of the evaluations for the final local search
_STEP = 0.3  # initial standard deviation of CMA-ES, in half widths of the box
_APART = 0.2  # minimum rms distance between starts
_STALE = 10  # number of generations without improvement after which an optimizer restarts elsewhere
_PROBE = 0.1  # step of the sensitivities at the worst point, in half widths of the box
AT_BOUND = 1.0 - 1e-9
_MOST_CORNERS = 512  # number of corners of the largest box whose corners are all evaluated
# share of the evaluations that a climb over corners may use, and their minimum number
_CLIMB_SHARE, _CLIMB_LEAST = 0.2, 256
_LEAST_STEP = 1e-3  # smallest step, in half widths of the box
# distances, in steps, within which the maximum of a fitted quadratic is searched for
_REACHES = (2.0, 8.0)
_SPREADS = (
    1.2,
    2.0,
    4.0,
)  # numbers of fitted points per coefficient, for a narrow, a medium and a wide neighbourhood
_FAR_ENOUGH = 0.3  # smallest move of the best point, in steps, after which the step is not reduced
_NEAR_BOUND = 0.9  # coordinate beyond which the bound itself is tried
# squared distance below which points have similar weights, as a share of the furthest point's
# squared distance
_NEAR = 0.05
_RIDGE = 1e-9  # relative regularization that keeps the fit unique with few points


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


def sobol_points(dimension: int, number: int, seed: int) -> Floats:
    """Return the first points of a scrambled Sobol sequence in the box -1 .. 1."""
    from scipy.stats.qmc import Sobol

    sequence = Sobol(dimension, rng=np.random.default_rng(seed))
    drawn = sequence.random_base2(max(0, int(number - 1).bit_length()))
    return 2.0 * drawn[:number] - 1.0


def explore(record: Record, dimension: int, seed: int, batch: int) -> None:
    """Evaluate the first points in whole batches, about a quarter of all evaluations."""
    share = record.limit // 4
    star = np.concatenate([np.zeros((1, dimension)), np.eye(dimension), -np.eye(dimension)])
    even = sobol_points(dimension, record.limit, seed)
    taken = 0

    def fill(points: Floats) -> Floats:
        """Return the points, padded with Sobol points to whole batches."""
        nonlocal taken
        missing = -len(points) % batch
        taken += missing
        return np.concatenate([points, even[taken - missing : taken]])

    values = record.call(fill(star), "one at a time")[: len(star)]
    if 2**dimension <= min(_MOST_CORNERS, max(share, LANES)):
        bits = np.arange(2**dimension)[:, None] >> np.arange(dimension) & 1
        corners = fill(np.where(bits, 1.0, -1.0))
        for start in range(0, len(corners), batch):
            record.call(corners[start : start + batch], "corners")
    else:
        _climb_corners(record, values, batch, fill)
    while record.used < share:
        record.call(fill(even[taken : (taken := taken + batch)]), "Sobol points")


def _climb_corners(
    record: Record, star: Floats, batch: int, fill: Callable[[Floats], Floats]
) -> None:
    """Climb over corners, first from the corner up the slopes, then from its opposite.

    Each step evaluates all neighbouring corners, then corners that combine improving sign changes.
    """
    dimension = len(star) // 2
    slopes = star[1 : dimension + 1] - star[dimension + 1 :]
    slopes = np.where(np.isfinite(slopes), slopes, 0.0)
    # dimensions sorted by the magnitude of the slope; small slopes have the least certain signs
    order = np.argsort(np.abs(slopes), kind="stable")
    corner, best, tried = np.where(slopes >= 0.0, 1.0, -1.0), -np.inf, set[bytes]()
    opposite = [-corner]
    # Each step uses two batches: the neighbouring corners, then the combined sign changes.
    share = record.used + max(_CLIMB_LEAST, int(_CLIMB_SHARE * record.limit))

    def call(expected: list[Floats]) -> tuple[list[Floats], Floats]:
        """Evaluate at most one batch of untried corners; return these corners and their values."""
        nonlocal corner, best
        candidates = [c for c in expected if c.tobytes() not in tried][:batch]
        if not candidates:
            return [], np.empty(0)
        tried.update(c.tobytes() for c in candidates)
        values = record.call(fill(np.array(candidates)), "corners")[: len(candidates)]
        if values.max() > best:
            best, corner = float(values.max()), candidates[np.argmax(values)]
        return candidates, values

    while record.used < share and record.left >= 2 * batch:
        middle, before = corner, best
        candidates, values = call(_neighbours(middle, order))
        if not candidates or best <= before:
            if not opposite:
                return
            corner, best = opposite.pop(), -np.inf
            continue
        # improvement by each single sign change
        at_middle = before if np.isfinite(before) else values[0]
        alone = {
            int(np.flatnonzero(c != middle)[0]): float(v - at_middle)
            for c, v in zip(candidates, values, strict=True)
            if np.count_nonzero(c != middle) == 1 and v > at_middle
        }
        gained = sorted(alone, key=lambda i: -alone[i])
        together = []
        for count in range(len(gained), 1, -1):
            changed = middle.copy()
            changed[gained[:count]] *= -1.0
            together.append(changed)
        if len(together) > 1 and record.used < share:
            call([*together, *_neighbours(together[0], order)])


def _neighbours(corner: Floats, order: np.ndarray) -> list[Floats]:
    """Return a corner and its neighbours with one or two signs changed, in this `order`."""
    doubles = ([i, j] for k, i in enumerate(order) for j in order[:k])
    corners = [corner]
    for changed in (*([i] for i in order), *doubles):
        corners.append(corner.copy())
        corners[-1][changed] *= -1.0
    return corners


def polish(record: Record, step: float, seed: int, batch: int, reserve: int) -> None:
    """Climb from the best point in the record until the step is small or evaluations run out.

    `reserve` evaluations are left unused.
    """
    iteration = 0
    suggested: list[Floats] = []  # points suggested by the slopes of the previous batch
    while step > _LEAST_STEP:
        center, best = record.place, record.best
        dimension = len(center)
        compass = np.clip(
            np.concatenate([center + step * np.eye(dimension), center - step * np.eye(dimension)]),
            -1.0,
            1.0,
        )
        points, point_values = np.concatenate(record.points), np.concatenate(record.values)
        is_finite = np.isfinite(point_values)
        data = points[is_finite], point_values[is_finite], center
        reaches = product([reach * step for reach in _REACHES], _SPREADS)
        tops = [find_top(*data, *reach) for reach in reaches if is_finite.any()]
        expected = np.array([*compass, *tops, *suggested])
        filled = round_up(len(expected), batch)
        if record.left - reserve < filled:
            return
        generator = make_generator(seed, 1, iteration)
        around = (
            step
            * generator.standard_normal((filled - len(expected), dimension))
            / np.sqrt(dimension)
        )
        if tops:  # Half of the random points lie on the line through center and fitted maximum.
            half = len(around) // 2
            around[:half] = generator.uniform(0.0, 1.5, (half, dimension)) * (tops[0] - center)
        values = record.call(
            np.clip(np.concatenate([expected, center + around]), -1.0, 1.0), "polish"
        )
        suggested = _suggest(center, best, compass, values[: 2 * dimension], step)
        moved = np.abs(record.place - center).max()
        step = 1.5 * step if moved > step else step if moved > _FAR_ENOUGH * step else step / 3.0
        iteration += 1


def _suggest(
    center: Floats, best: float, compass: Floats, values: Floats, step: float
) -> list[Floats]:
    """Return points suggested by a parabola in each dimension and by the slope."""
    dimension = len(center)
    up, down = values[:dimension], values[dimension:]
    ahead = np.diag(compass[:dimension]) - center
    behind = np.diag(compass[dimension:]) - center
    up, down = np.where(np.isfinite(up), up, best), np.where(np.isfinite(down), down, best)
    # A parabola gives the slope and the curvature; at a bound, the slope is one-sided.
    gradient, curvature = np.zeros(dimension), np.zeros(dimension)
    both = (ahead > 0.0) & (behind < 0.0)
    a, b = ahead[both], -behind[both]
    rise, fall = (up[both] - best) / a, (down[both] - best) / b
    gradient[both] = (rise * b - fall * a) / (a + b)
    curvature[both] = 2.0 * (rise + fall) / (a + b)
    only_up, only_down = (ahead > 0.0) & ~both, (behind < 0.0) & ~both
    gradient[only_up] = (up[only_up] - best) / ahead[only_up]
    gradient[only_down] = (down[only_down] - best) / behind[only_down]
    with np.errstate(divide="ignore", invalid="ignore"):
        newton = np.where(curvature < 0.0, -gradient / curvature, np.sign(gradient) * 4.0 * step)
    newton = np.clip(np.where(np.isfinite(newton), newton, 0.0), -8.0 * step, 8.0 * step)
    better = np.where(up > np.maximum(down, best), ahead, np.where(down > best, behind, 0.0))
    size = np.abs(gradient).max()
    along = gradient / size if size > 0.0 else np.zeros(dimension)
    suggestions = [center + newton, center + better, center + 0.5 * newton, center + 2.0 * newton]
    suggestions += [center + factor * step * along for factor in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)]
    suggestions += [center + factor * step * np.sign(gradient) for factor in (1.0, 4.0)]
    snapped = [
        np.where(np.abs(point) > _NEAR_BOUND, np.sign(point), point)
        for point in (center, center + newton, center + better)
    ]
    corner = np.where(gradient > 0.0, 1.0, np.where(gradient < 0.0, -1.0, center))
    return [*suggestions, *snapped, corner]


def find_top(
    points: Floats, values: Floats, center: Floats, radius: float, spread: float
) -> Floats:
    """Return the point [dimension] at which a fitted quadratic is largest.

    The point differs from `center` by at most `radius` in each dimension. The quadratic can
    represent ridges that are oblique to the dimensions. `points` [point, dimension] are in the box
    -1 .. 1 and their `values` [point] are finite. The nearest points are used, `spread` times as
    many as there are coefficients, with weights that decrease with distance.
    """
    dimension = len(center)
    rows, columns = np.triu_indices(dimension)
    number = 1 + dimension + len(rows)
    distances = ((points - center) ** 2).sum(axis=1)
    near = np.argsort(distances, kind="stable")[: round(spread * number)]
    size = float(np.sqrt(distances[near[-1]])) or 1.0
    moved = (points[near] - center) / size
    terms = np.column_stack([np.ones(len(near)), moved, moved[:, rows] * moved[:, columns]])
    weights = 1.0 / (_NEAR + (moved**2).sum(axis=1))
    normal = terms.T @ (weights[:, None] * terms) + _RIDGE * weights.sum() * np.eye(number)
    coefficients = np.linalg.solve(
        normal, terms.T @ (weights * (values[near] - values[near].max()))
    )
    slope, curvature = coefficients[1 : dimension + 1], np.zeros((dimension, dimension))
    curvature[rows, columns] = coefficients[dimension + 1 :]
    curvature += curvature.T

    def fall(step: Floats) -> tuple[float, Floats]:
        return -float(slope @ step + 0.5 * step @ curvature @ step), -(slope + curvature @ step)

    low, high = np.maximum(-1.0, center - radius), np.minimum(1.0, center + radius)
    bounds = np.column_stack([low - center, high - center]) / size
    optimum = minimize(fall, np.zeros(dimension), jac=True, bounds=bounds, method="L-BFGS-B")
    return np.clip(center + size * optimum.x, low, high)
