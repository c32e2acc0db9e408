"""The last steps to a maximum in a box: slopes and curvatures, then the steps that they suggest."""

import numpy as np

from abhv_mc.search.evaluation import Floats, make_generator
from abhv_mc.search.quadratic import find_top
from abhv_mc.search.record import Record

_LEAST_STEP = 1e-3  # half widths of the box
_REACHES = (2.0, 8.0)  # steps: how far away the top of a fitted quadratic may be
_NEAR_BOUND = 0.9  # beyond it, the bound itself is tried


def polish(record: Record, step: float, seed: int, batch: int, reserve: int) -> None:
    """Climb from the record's best place until the step is small or ``reserve`` evaluations are left."""
    iteration = 0
    while step > _LEAST_STEP:
        place, best = record.place, record.best
        dimension = len(place)
        compass = np.clip(
            np.concatenate([place + step * np.eye(dimension), place - step * np.eye(dimension)]), -1.0, 1.0
        )
        filled = -(-2 * dimension // batch) * batch
        if record.left - reserve < filled + batch:
            return
        generator = make_generator(seed, 1, iteration)
        around = place + step * generator.standard_normal((filled - 2 * dimension, dimension)) / np.sqrt(dimension)
        values = record.call(np.concatenate([compass, np.clip(around, -1.0, 1.0)]), "polish")
        steps = np.array([*_tops(record, place, step), *_suggest(place, best, compass, values[: 2 * dimension], step)])
        room = batch - len(steps)
        if room > 0:  # shorter and longer variants of the suggested steps, dimension by dimension
            factors = generator.uniform(0.0, 1.5, (room, dimension))
            steps = np.concatenate([steps, (steps[0] - place) * factors + place])
        record.call(np.clip(steps[:batch], -1.0, 1.0), "polish")
        gained = record.best - best
        step = step * 1.5 if gained > 0.0 and np.abs(record.place - place).max() > step else step / 3.0
        iteration += 1


def _tops(record: Record, place: Floats, step: float) -> list[Floats]:
    points, values = np.concatenate(record.points), np.concatenate(record.values)
    known = np.isfinite(values)
    return [find_top(points[known], values[known], place, reach * step) for reach in _REACHES] if known.any() else []


def _suggest(place: Floats, best: float, compass: Floats, values: Floats, step: float) -> list[Floats]:
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
        np.where(np.abs(one) > _NEAR_BOUND, np.sign(one), one) for one in (place, place + newton, place + better)
    ]
    corner = np.where(gradient > 0.0, 1.0, np.where(gradient < 0.0, -1.0, place))
    return [*found, *snapped, corner]
