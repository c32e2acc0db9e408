"""A quadratic through what is known about a place, and where it is highest: the step that slopes alone cannot suggest.

Slopes and curvatures along each dimension see no ridge that lies across them. All points near a place together do.
"""

import numpy as np
from scipy.optimize import minimize

from abhv_mc.array_types import Floats

_NEAR = 0.05  # squared distance, of the furthest point's, within which all points count about the same
_RIDGE = 1e-9  # of the points' weight: keeps the fit unique where they are fewer than the coefficients


def find_top(points: Floats, values: Floats, place: Floats, radius: float, spread: float = 2.0) -> Floats:
    """The highest place ``[dimension]`` of a quadratic fitted to the points, within ``radius`` in each dimension.

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
    coefficients = np.linalg.solve(normal, terms.T @ (weights * (values[near] - values[near].max())))
    slope, curvature = coefficients[1 : dimension + 1], np.zeros((dimension, dimension))
    curvature[rows, columns] = coefficients[dimension + 1 :]
    curvature += curvature.T

    def fall(step: Floats) -> tuple[float, Floats]:
        return -float(slope @ step + 0.5 * step @ curvature @ step), -(slope + curvature @ step)

    low, high = np.maximum(-1.0, place - radius), np.minimum(1.0, place + radius)
    bounds = np.column_stack([low - place, high - place]) / size
    found = minimize(fall, np.zeros(dimension), jac=True, bounds=bounds, method="L-BFGS-B")
    return np.clip(place + size * found.x, low, high)
