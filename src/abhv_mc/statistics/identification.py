"""Estimation of parameters from test flights by Levenberg-Marquardt, and of their spread by REML.

Coordinates of parameters are relative to their dispersions: 0 is the mean and 1 a standard
deviation. Nuisance parameters keep a standard normal prior; listed parameters have none.
"""

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Mask

_STEP = 0.03  # half width of central differences; over wider steps, tables bend
_MOST_STEPS = 24
_DAMPING, _CHANGE = 1e-3, 10.0  # first damping; its factor after each step
_CONVERGED = 0.2  # change, in standard errors, below which the iteration ends
_FLAT = 1e-6  # precision of the prior of listed parameters, which keeps matrices regular
# correlation beyond which parameters, and standard error beyond which a parameter, is not separable
_SEPARABLE, _LARGEST_ERROR = 0.98, 10.0

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
    p_value: float  # probability of a larger chi-square if the model is valid
    freedom: int  # degrees of freedom of chi-square
    simulations: int  # number of simulations of each flight
    converged: bool


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
    from scipy.special import chdtrc

    count, columns = len(data), len(shared)
    offsets = _STEP * np.vstack([np.zeros(columns), np.eye(columns), -np.eye(columns)])
    points, errors, listed = np.zeros((count, columns)), np.zeros((count, columns)), listed.copy()
    owners = np.where(shared, vehicles[:, None], np.arange(count)[:, None])
    unknowns = owners * columns + np.arange(columns)  # [flight, column]
    first = np.unique(unknowns, return_index=True)[1]
    inseparable, simulations, change = [], 0, np.inf
    solutions: dict[int, Any] = dict.fromkeys(vehicles.tolist(), (np.inf,))
    damping = dict.fromkeys(solutions, _DAMPING)
    while change >= _CONVERGED and simulations < _MOST_STEPS * len(offsets):
        outputs = simulate(points[:, None] + offsets)
        residuals = data - outputs[:, 0]
        noise = sigma.copy()
        for channel in np.unique(channels[np.isnan(sigma)]):
            steps = np.diff(residuals[:, channels == channel], axis=1)
            noise[channels == channel] = np.sqrt(np.nanmean(steps**2) / 2.0)
        noise = np.maximum(noise, np.finfo(float).tiny)
        slopes = (outputs[:, 1 : columns + 1] - outputs[:, columns + 1 :]) / (2.0 * _STEP * noise)
        residuals = residuals / noise
        is_valid = np.isfinite(residuals)
        slopes = np.where(is_valid[:, None] & np.isfinite(slopes), slopes, 0.0)
        if not simulations:
            inseparable = list(_separate(slopes, listed))
        simulations += len(offsets)
        priors = np.broadcast_to(np.where(listed, _FLAT, 1.0), points.shape)
        chi_square = np.nansum(residuals**2) + np.sum((priors * points**2).flat[first])
        freedom = int(is_valid.sum() - np.sum(priors.flat[first] < 1.0))
        valid, change = np.nan_to_num(residuals), 0.0
        for vehicle in damping:
            rows = np.flatnonzero(vehicles == vehicle)
            own, index = np.unique(unknowns[rows], return_inverse=True)
            index = index.reshape(len(rows), columns)
            current, precision, vector = np.zeros((3, own.size))
            current[index], precision[index] = points[rows], priors[rows]
            total = np.diag(precision)
            for row, numbers in zip(rows, index, strict=True):
                total[np.ix_(numbers, numbers)] += slopes[row] @ slopes[row].T
                vector[numbers] += slopes[row] @ valid[row]
            loss = float(np.sum(valid[rows] ** 2) + precision @ current**2)
            loss += 2.0 * float(np.sum(is_valid[rows] @ np.log(noise)))
            if loss < solutions[vehicle][0]:
                solutions[vehicle] = loss, current, total, vector - precision * current
                damping[vehicle] /= _CHANGE
            else:
                damping[vehicle] *= _CHANGE**2
            _, current, total, gradient = solutions[vehicle]
            covariance = np.linalg.inv(total)
            deviations = np.sqrt(np.diag(covariance))
            change = max(change, float(np.abs(covariance @ gradient / deviations).max()))
            damped = total + damping[vehicle] * np.diag(np.diag(total))
            points[rows] = (current + np.linalg.solve(damped, gradient))[index]
            errors[rows] = deviations[index]
    return Estimates(
        points=points,
        errors=errors,
        listed=listed,
        inseparable=tuple(inseparable),
        residuals=residuals,
        sigma=noise,
        p_value=float(chdtrc(freedom, chi_square)),
        freedom=freedom,
        simulations=simulations,
        converged=change < _CONVERGED,
    )


def _separate(slopes: Floats, listed: Mask) -> Iterator[tuple[tuple[int, ...], float]]:
    """Yield groups of columns that cannot be separated, and remove them from `listed`."""
    matrix = np.einsum("fao,fbo->ab", slopes, slopes) / len(slopes)
    while listed.any():
        columns = np.flatnonzero(listed)
        precision = np.diag(np.where(listed, _FLAT, 1.0))
        covariance = np.linalg.inv(matrix + precision)[np.ix_(columns, columns)]
        errors = np.sqrt(np.diag(covariance))
        correlations = covariance / np.outer(errors, errors)
        linked = np.abs(correlations) > _SEPARABLE
        links = linked.sum(axis=0) + (errors > _LARGEST_ERROR)
        members = np.flatnonzero(linked[links.argmax()])
        if links.max() < 2:
            return
        yield tuple(columns[members].tolist()), float(correlations[members[0], members[-1]])
        listed[columns[members]] = False


def find_spread(estimates: Floats, errors: Floats) -> tuple[float, float, float]:
    """Return mean, its standard error and the spread of `estimates` with standard errors.

    The spread is the standard deviation of the true values, by restricted maximum likelihood
    (Patterson & Thompson, Biometrika 58, 1971).
    """
    from scipy.optimize import minimize_scalar

    def fit(spread: float) -> tuple[float, float, float, float]:
        weights = 1.0 / (spread**2 + errors**2)
        mean = float(weights @ estimates / weights.sum())
        squares = weights @ (estimates - mean) ** 2
        loss = float(np.log(weights.sum()) - np.log(weights).sum() + squares)
        return loss, mean, float(weights.sum() ** -0.5), spread

    largest = 3.0 * float(np.std(estimates)) + np.finfo(float).tiny
    best = minimize_scalar(lambda spread: fit(spread)[0], bounds=(0.0, largest), method="bounded")
    return min(fit(0.0), fit(float(best.x)))[1:]
