"""Estimation of parameters from test flights by Levenberg-Marquardt, and of their spread by REML.

Coordinates of parameters are relative to their dispersions: 0 is the mean and 1 a standard
deviation. Nuisance parameters keep a standard normal prior; listed parameters have none.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask

_STEP = 0.03  # half width of central differences; over wider steps, tables bend
_MOST_STEPS = 24
_DAMPING, _CHANGE = 1e-3, 10.0  # first damping; its factor after each step
_CONVERGED = 0.2  # change, in standard errors, below which the iteration ends
_FLAT = 1e-6  # precision of the prior of listed parameters, which keeps matrices regular
# Parameters are not separable if the smallest eigenvalue of their scaled information is below
# _SEPARABLE (a correlation of 0.98), or if a standard error exceeds _LARGEST_ERROR.
_SEPARABLE, _LARGEST_ERROR = 0.02, 10.0
_MEMBER = 0.3  # smallest component of a parameter of a group that is not separable

Simulate = Callable[[Floats], Floats]


class Estimates(NamedTuple):
    """Estimated coordinates of the parameters in each flight."""

    points: Floats  # [flight, column]
    errors: Floats  # [flight, column] standard errors
    listed: Mask  # [column] listed parameters that are estimated without prior
    # groups of listed columns that the flights cannot separate, with the correlation of a pair
    inseparable: tuple[tuple[tuple[int, ...], float], ...]
    residuals: Floats  # [flight, output], in standard deviations of the noise
    sigma: Floats  # [output] standard deviation of the noise
    chi_square: float
    freedom: int  # degrees of freedom
    simulations: int  # number of simulations of each flight
    converged: bool

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-square if the model is valid."""
        from scipy.special import chdtrc

        return float(chdtrc(self.freedom, self.chi_square))


def estimate(
    simulate: Simulate,
    data: Floats,
    sigma: Floats,
    channels: Ints,
    vehicles: Ints,
    *,
    shared: Mask,
    listed: Mask,
) -> Estimates:
    """Estimate parameters from `data` [flight, output], with NaN for missing values.

    `simulate` returns outputs [flight, point, output] at points [flight, point, column]. `sigma`
    [output] is the noise, NaN if it is estimated from differences of successive residuals of the
    output's channel, which a smooth misfit does not change.
    `shared` [column] parameters have one value for each vehicle, others one for each flight.
    """
    count, columns = len(data), len(shared)
    offsets = np.vstack([np.zeros(columns), _STEP * np.eye(columns), -_STEP * np.eye(columns)])
    points, errors, listed = np.zeros((count, columns)), np.zeros((count, columns)), listed.copy()
    inseparable = []
    converged, simulations = False, 0
    best = dict.fromkeys(np.unique(vehicles).tolist(), np.inf)
    damping, solutions = dict.fromkeys(best, _DAMPING), {}
    while True:
        outputs = simulate(points[:, None] + offsets)
        simulations += len(offsets)
        residuals = data - outputs[:, 0]
        noise = sigma.copy()
        for channel in np.unique(channels[np.isnan(sigma)]):
            steps = np.diff(residuals[:, channels == channel], axis=1)
            noise[channels == channel] = np.sqrt(np.nanmean(steps**2) / 2.0)
        noise = np.maximum(noise, np.finfo(float).tiny)
        slopes = (outputs[:, 1 : columns + 1] - outputs[:, columns + 1 :]) / (2.0 * _STEP * noise)
        residuals = residuals / noise
        slopes = np.where(np.isfinite(residuals)[:, None] & np.isfinite(slopes), slopes, 0.0)
        if simulations == len(offsets):
            inseparable = list(_separate(slopes, listed))
        change, freedom = 0.0, int(np.isfinite(residuals).sum())
        chi_square = float(np.nansum(residuals**2))
        valid = np.nan_to_num(residuals)
        for rows, index, matrix, vector in _normal_equations(slopes, valid, vehicles, shared):
            current, precision = np.zeros((2, len(vector)))
            current[index], precision[index] = points[rows], np.where(listed, _FLAT, 1.0)
            prior = float(precision @ current**2)
            loss = float(np.sum(valid[rows] ** 2)) + prior
            chi_square += prior
            freedom -= int(np.sum(precision < 1.0))
            vehicle = int(vehicles[rows[0]])
            loss += 2.0 * float(np.sum(np.isfinite(residuals[rows]) @ np.log(noise)))
            if loss < best[vehicle]:
                best[vehicle] = loss
                damping[vehicle] /= _CHANGE
                total = matrix + np.diag(precision)
                solutions[vehicle] = current, total, vector - precision * current
            else:
                damping[vehicle] *= _CHANGE**2
            current, total, gradient = solutions[vehicle]
            covariance = np.linalg.inv(total)
            own = np.sqrt(np.diag(covariance))
            change = max(change, float(np.abs(covariance @ gradient / own).max()))
            damped = total + damping[vehicle] * np.diag(np.diag(total))
            points[rows] = (current + np.linalg.solve(damped, gradient))[index]
            errors[rows] = own[index]
        converged = change < _CONVERGED
        if converged or simulations == _MOST_STEPS * len(offsets):
            break
    return Estimates(
        points=points,
        errors=errors,
        listed=listed,
        inseparable=tuple(inseparable),
        residuals=residuals,
        sigma=noise,
        chi_square=chi_square,
        freedom=freedom,
        simulations=simulations,
        converged=converged,
    )


_Normal = tuple[Ints, Ints, Floats, Floats]


def _normal_equations(
    slopes: Floats, residuals: Floats, vehicles: Ints, shared: Mask
) -> Iterator[_Normal]:
    """Yield flights, unknowns [flight, column], matrix and vector of each vehicle."""
    for vehicle in np.unique(vehicles):
        rows = np.flatnonzero(vehicles == vehicle)
        index = np.zeros((len(rows), len(shared)), np.int64)
        number, own = int(shared.sum()), len(rows) * int((~shared).sum())
        index[:, shared] = np.arange(number)
        index[:, ~shared] = number + np.arange(own).reshape(len(rows), -1)
        matrix, vector = np.zeros((number + own, number + own)), np.zeros(number + own)
        for unknowns, row in zip(index, rows, strict=True):
            matrix[np.ix_(unknowns, unknowns)] += slopes[row] @ slopes[row].T
            vector[unknowns] += slopes[row] @ residuals[row]
        yield rows, index, matrix, vector


def _separate(slopes: Floats, listed: Mask) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield groups of columns that cannot be separated, and remove them from `listed`."""
    matrix = np.einsum("fao,fbo->ab", slopes, slopes) / len(slopes)
    while listed.any():
        columns = np.flatnonzero(listed)
        precision = np.diag(np.where(listed, _FLAT, 1.0))
        covariance = np.linalg.inv(matrix + precision)[np.ix_(columns, columns)]
        information = np.linalg.inv(covariance)
        size, errors = np.sqrt(np.diag(information)), np.sqrt(np.diag(covariance))
        values, vectors = np.linalg.eigh(information / np.outer(size, size))
        members = np.flatnonzero(np.abs(vectors[:, 0]) > _MEMBER)
        if values[0] > _SEPARABLE:
            members = np.flatnonzero(errors > _LARGEST_ERROR)[:1]
        if not members.size:
            return
        first, last = members[0], members[-1]
        correlation = covariance[first, last] / (errors[first] * errors[last])
        yield tuple(columns[members].tolist()), float(correlation)
        listed[columns[members]] = False


def find_spread(estimates: Floats, errors: Floats) -> tuple[float, float, float]:
    """Return mean, its standard error and the spread of `estimates` with standard errors.

    The spread is the standard deviation of the true values, by restricted maximum likelihood
    (Patterson & Thompson, Biometrika 58, 1971).
    """
    from scipy.optimize import minimize_scalar

    def locate(spread: float) -> tuple[Floats, float]:
        weights = 1.0 / (spread**2 + errors**2)
        return weights, float(weights @ estimates / weights.sum())

    def loss(spread: float) -> float:
        weights, mean = locate(spread)
        squares = weights @ (estimates - mean) ** 2
        return float(np.log(weights.sum()) - np.log(weights).sum() + squares)

    largest = 3.0 * float(np.std(estimates)) + np.finfo(float).tiny
    spread = float(minimize_scalar(loss, bounds=(0.0, largest), method="bounded").x)
    spread = min((0.0, spread), key=loss)
    weights, mean = locate(spread)
    return mean, float(weights.sum() ** -0.5), spread
