"""Local ascent to a maximum in a box, using slopes and curvatures."""

from itertools import product

import numpy as np
from scipy.optimize import minimize

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import Record, make_generator, round_up

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
    points: Floats, values: Floats, center: Floats, radius: float, spread: float = 2.0
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
