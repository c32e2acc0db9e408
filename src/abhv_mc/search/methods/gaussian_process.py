"""Gaussian process regression of noise-free values by maximum posterior density.

C.E. Rasmussen, C.K.I. Williams, "Gaussian Processes for Machine Learning" (2006), chapters 2 and 5.
The covariance is the sum of a quadratic polynomial's covariance and a stationary part with a length
scale for each dimension.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize

from abhv_mc.array_types import Floats

_LENGTH_SPREAD = np.sqrt(3.0)  # prior standard deviation of the logarithm of a length scale
# range of the log standard deviations of the polynomial's terms
_LOWEST, _HIGHEST = np.log(1e-3), np.log(1e3)
# range of the nugget's log variance, for values with a variance of about 1
_NUGGET = (np.log(1e-7), np.log(1e-2))
_ITERATIONS = 60
_TERMS = 3  # number of polynomial terms: constant, linear and quadratic


@dataclass(frozen=True)
class GaussianProcess:
    """Gaussian process conditioned on values; infinitely differentiable if `smooth`."""

    smooth: bool
    points: Floats  # points of the data [point, dimension]
    values: Floats  # values at the points [point]
    # logarithms of the variances (terms, stationary part, nugget) and of the length scales
    logs: Floats
    factor: Floats  # lower Cholesky factor of the covariance [point, point]
    weights: Floats  # inverse of the covariance times the values [point]

    def predict(self, points: Floats) -> tuple[Floats, Floats]:
        """Return means and standard deviations at points [point]."""
        across, _ = self._prior(points, self.points)
        explained = solve_triangular(self.factor, across.T, lower=True)
        variance = self._prior_variance(points) - (explained**2).sum(axis=0)
        return across @ self.weights, np.sqrt(np.maximum(variance, 1e-12))

    def covariance(self, points: Floats) -> Floats:
        """Return the covariance [point, point] of the conditioned process."""
        explained = solve_triangular(self.factor, self._prior(self.points, points)[0], lower=True)
        return self._prior(points, points)[0] - explained.T @ explained

    def left_out(self) -> Floats:
        """Return standardized leave-one-out errors [point]."""
        inverse = cho_solve((self.factor, True), np.eye(len(self.values)))
        return np.asarray(self.weights / np.sqrt(np.diag(inverse)))

    @cached_property
    def inflation(self) -> float:
        """Factor (>= 1) on standard deviations, chosen to explain the leave-one-out errors."""
        return max(1.0, float(np.sqrt(np.mean(self.left_out() ** 2))))

    def _prior(self, first: Floats, second: Floats) -> tuple[Floats, Floats]:
        return _covariance(first, second, self.logs, self.smooth)

    def _prior_variance(self, points: Floats) -> Floats:
        squares = (points**2).sum(axis=1)
        constant, linear, quadratic, stationary = np.exp(self.logs[: _TERMS + 1])
        return np.asarray(constant + linear * squares + quadratic * squares**2 + stationary)


def _covariance(first: Floats, second: Floats, logs: Floats, smooth: bool) -> tuple[Floats, Floats]:
    """Return prior covariances and their derivatives.

    The derivatives with respect to the squared distance are multiplied by -2.
    """
    constant, linear, quadratic, stationary = np.exp(logs[: _TERMS + 1])
    lengths = np.exp(logs[_TERMS + 2 :])
    a, b = first / lengths, second / lengths
    squared = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2.0 * a @ b.T
    squared = np.maximum(squared, 0.0)
    if smooth:
        part = slope = stationary * np.exp(-0.5 * squared)
    else:  # Matern covariance with smoothness 5/2
        distance = np.sqrt(5.0 * squared)
        decay = stationary * np.exp(-distance)
        part = decay * (1.0 + distance + distance**2 / 3.0)
        slope = decay * (1.0 + distance) * (5.0 / 3.0)
    products = first @ second.T
    return constant + linear * products + quadratic * products**2 + part, slope


def _loss(
    logs: Floats, points: Floats, values: Floats, differences: Floats, smooth: bool
) -> tuple[float, Floats]:
    """Return the negative log posterior density of `logs`, and its gradient.

    `differences` [point, point, dimension] contains the squared distances in each dimension.
    """
    number, dimension = points.shape
    prior, slope = _covariance(points, points, logs, smooth)
    variances = np.exp(logs[: _TERMS + 2])
    try:
        factor = cholesky(prior + variances[-1] * np.eye(number), lower=True)
    except np.linalg.LinAlgError:
        return 1e10, np.zeros_like(logs)
    inverse = cho_solve((factor, True), np.eye(number))
    weights = inverse @ values
    # derivative of the loss with respect to each covariance
    change = 0.5 * (inverse - np.outer(weights, weights))
    products = points @ points.T
    stationary = prior - variances[0] - variances[1] * products - variances[2] * products**2
    gradient = np.empty_like(logs)
    gradient[0] = variances[0] * change.sum()
    gradient[1] = variances[1] * (change * products).sum()
    gradient[2] = variances[2] * (change * products**2).sum()
    gradient[3] = (change * stationary).sum()
    gradient[4] = variances[4] * np.trace(change)
    lengths = slice(_TERMS + 2, None)
    gradient[lengths] = np.tensordot(change * slope, differences) * np.exp(-2.0 * logs[lengths])
    far = (logs[lengths] - _prior_lengths(dimension)) / _LENGTH_SPREAD
    gradient[lengths] += far / _LENGTH_SPREAD
    loss = 0.5 * values @ weights + np.log(np.diag(factor)).sum() + 0.5 * (far**2).sum()
    return float(loss), gradient


def _prior_lengths(dimension: int) -> float:
    """Return the prior median of the logarithm of a length scale.

    The median increases with the number of dimensions, as the distances between points do: C.
    Hvarfner, E.O. Hellsten, L. Nardi, "Vanilla Bayesian optimization performs great in high
    dimensions", ICML 2024.
    """
    return float(np.sqrt(2.0) + 0.5 * np.log(dimension))


def fit_process(points: Floats, values: Floats, smooth: bool, starts: Floats) -> GaussianProcess:
    """Return the most likely process found by optimizing its parameters from all `starts`."""
    differences = (points[:, None, :] - points) ** 2
    dimension = points.shape[1]
    bounds = [
        *[(2.0 * _LOWEST, 2.0 * _HIGHEST)] * (_TERMS + 1),
        _NUGGET,
        *[(np.log(0.05), np.log(1e3))] * dimension,
    ]
    fits = [
        minimize(
            _loss,
            start,
            (points, values, differences, smooth),
            "L-BFGS-B",
            jac=True,
            bounds=bounds,
            options={"maxiter": _ITERATIONS},
        )
        for start in starts
    ]
    return condition(points, values, smooth, min(fits, key=lambda fit: float(fit.fun)).x)


def condition(points: Floats, values: Floats, smooth: bool, logs: Floats) -> GaussianProcess:
    """Return the process conditioned on values, for given variances and length scales."""
    prior, _ = _covariance(points, points, logs, smooth)
    factor = cholesky(prior + np.exp(logs[_TERMS + 1]) * np.eye(len(points)), lower=True)
    return GaussianProcess(smooth, points, values, logs, factor, cho_solve((factor, True), values))


def draw_starts(dimension: int, number: int, generator: np.random.Generator) -> Floats:
    """Return random starting points for fitting a process."""
    middle = np.r_[0.0, -2.0, -4.0, 0.0, -12.0, np.full(dimension, _prior_lengths(dimension))]
    spread = np.r_[1.0, 1.0, 1.0, 1.0, 2.0, np.full(dimension, 1.0)]
    return middle + spread * generator.standard_normal((number, len(middle)))
