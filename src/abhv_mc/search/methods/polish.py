"""The last steps to a maximum in a box: slopes and curvatures, then the steps that they suggest."""

import numpy as np
from scipy.optimize import minimize

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import Record, make_generator, round_up

_LEAST_STEP = 1e-3  # half widths of the box
_REACHES = (2.0, 8.0)  # steps: how far away the top of a fitted quadratic may be
_SPREADS = (
    1.2,
    2.0,
    4.0,
)  # points of a fit for each coefficient: from a narrow neighbourhood to a wide one
_FAR_ENOUGH = 0.3  # steps: the best place moved at least so far where the step stays
_NEAR_BOUND = 0.9  # beyond it, the bound itself is tried
_NEAR = (
    0.05  # squared distance, of the furthest point's, within which all points count about the same
)
_RIDGE = (
    1e-9  # of the points' weight: keeps the fit unique where they are fewer than the coefficients
)


def polish(record: Record, step: float, seed: int, batch: int, reserve: int) -> None:
    """Climb from the record's best place until the step is small or ``reserve`` evaluations are left."""
    iteration = 0
    suggested: list[Floats] = []  # by the slopes of the batch before
    while step > _LEAST_STEP:
        place, best = record.place, record.best
        dimension = len(place)
        compass = np.clip(
            np.concatenate([place + step * np.eye(dimension), place - step * np.eye(dimension)]),
            -1.0,
            1.0,
        )
        tops = _tops(record, place, step)
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
        if (
            tops
        ):  # half of them: shorter and longer variants of the step to a top, dimension by dimension
            half = len(around) // 2
            around[:half] = generator.uniform(0.0, 1.5, (half, dimension)) * (tops[0] - place)
        values = record.call(
            np.clip(np.concatenate([expected, place + around]), -1.0, 1.0), "polish"
        )
        suggested = _suggest(place, best, compass, values[: 2 * dimension], step)
        moved = np.abs(record.place - place).max()
        step = 1.5 * step if moved > step else step if moved > _FAR_ENOUGH * step else step / 3.0
        iteration += 1


def _tops(record: Record, place: Floats, step: float) -> list[Floats]:
    points, values = np.concatenate(record.points), np.concatenate(record.values)
    known = np.isfinite(values)
    if not known.any():
        return []
    points, values = points[known], values[known]
    return [
        find_top(points, values, place, reach * step, spread)
        for reach in _REACHES
        for spread in _SPREADS
    ]


def _suggest(
    place: Floats, best: float, compass: Floats, values: Floats, step: float
) -> list[Floats]:
    """Places that a parabola in each dimension and the slope suggest."""
    dimension = len(place)
    up, down = values[:dimension], values[dimension:]
    ahead = np.diag(compass[:dimension]) - place
    behind = np.diag(compass[dimension:]) - place
    up, down = np.where(np.isfinite(up), up, best), np.where(np.isfinite(down), down, best)
    # Slope and curvature of the parabola through three points, or the slope to one where a bound is in the way.
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
    found = [place + newton, place + better, place + 0.5 * newton, place + 2.0 * newton]
    found += [place + factor * step * along for factor in (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)]
    found += [place + factor * step * np.sign(gradient) for factor in (1.0, 4.0)]
    snapped = [
        np.where(np.abs(one) > _NEAR_BOUND, np.sign(one), one)
        for one in (place, place + newton, place + better)
    ]
    corner = np.where(gradient > 0.0, 1.0, np.where(gradient < 0.0, -1.0, place))
    return [*found, *snapped, corner]


def find_top(
    points: Floats, values: Floats, place: Floats, radius: float, spread: float = 2.0
) -> Floats:
    """The highest place ``[dimension]`` of a quadratic fitted to the points, within ``radius`` in each dimension.

    It sees a ridge that lies across the dimensions, as slopes and curvatures along each of them do not.
    ``points`` [point, dimension] lie in the box -1 .. 1, their ``values`` [point] are finite. The nearest take part,
    ``spread`` for each coefficient; the nearer, the more they count.
    """
    dimension = len(place)
    rows, columns = np.triu_indices(dimension)
    number = 1 + dimension + len(rows)
    apart = ((points - place) ** 2).sum(axis=1)
    near = np.argsort(apart, kind="stable")[: round(spread * number)]
    size = float(np.sqrt(apart[near[-1]])) or 1.0
    moved = (points[near] - place) / size
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

    low, high = np.maximum(-1.0, place - radius), np.minimum(1.0, place + radius)
    bounds = np.column_stack([low - place, high - place]) / size
    found = minimize(fall, np.zeros(dimension), jac=True, bounds=bounds, method="L-BFGS-B")
    return np.clip(place + size * found.x, low, high)
