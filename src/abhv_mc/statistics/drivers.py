"""Standardized rank regression, which identifies the inputs that drive an output.

The coefficients come from the correlation matrix of the ranks (Saltelli et al., "Sensitivity
Analysis in Practice", 2004; Iman & Conover 1979). Their intervals are bootstrapped. The ranks are
recomputed for each resample, because the coefficients depend on them. An input is a driver if its
coefficient is large and significant at a controlled false-discovery rate over all inputs and
outputs. Effects are not linear in ranks if many outputs are equal, so monotonic curves replace the
terms of inputs whose monotonic curve fits at least as well (isotonic regression).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import betainc, ndtri

from abhv_mc.array_types import Floats, Indices, Mask
from abhv_mc.statistics.given_data import FALSE_DISCOVERY_RATE, LEAST_SHARE
from abhv_mc.statistics.ranks import discoveries, split_partners, standard_ranks

LEAST_COEFFICIENT = 0.2  # smallest absolute coefficient of a driver
_FEWEST_SPARE = 10  # minimum excess of the number of flights over the number of inputs
_PARTNERS = 0.3  # minimum rank correlation with a driver at which an input counts as related to it
_TWINS = 0.9  # rank correlation above which a regression cannot distinguish two inputs
_RESAMPLES = 300
# maximum number of resampled flights; standard errors are scaled to the number of all flights
_MOST_RESAMPLED = 1000


@dataclass(frozen=True)
class RankDrivers:
    """Rank regression coefficients [input, output]; NaN if the output is constant."""

    srrc: Floats
    srrc_low: Floats
    srrc_high: Floats
    p_value: Floats  # p-values of the hypothesis that the coefficient is zero
    found: Mask  # whether each input is a driver
    # index of the driver with which an input is correlated; -1 for none
    moves_with: Indices
    explained: Floats  # R^2 of the rank regression, by output
    # residuals of the standardized ranks, after monotonic curves [flight, output]
    residuals: Floats


def rank_drivers(
    inputs: Floats, outputs: Floats, confidence: float = 0.95, folded: Floats | None = None
) -> RankDrivers | None:
    """Return the rank coefficients of `inputs` for `outputs`; None if flights are too few.

    `inputs` has shape [flight, input]; `outputs` has shape [flight, output] and may contain
    infinities. Constant inputs get zero coefficients. `folded` contains the distance of each input
    from its median; these columns follow the inputs as further regressors. If a monotonic curve of
    the input, or of its distance, explains as much as both terms, only this one can be a driver.
    """
    if folded is not None:
        inputs = np.concatenate([inputs, folded], axis=1)
    flights, count = inputs.shape
    freedom = flights - count - 1
    if flights < count + _FEWEST_SPARE or not count or not outputs.shape[1]:
        return None
    values = np.concatenate([inputs, outputs], axis=1)
    ranks = standard_ranks(values)
    x, y = ranks[:, :count], ranks[:, count:]
    moving = np.asarray(y.any(axis=0), dtype=np.bool_)
    correlation = x.T @ ranks / flights
    inside, across = correlation[:, :count].copy(), correlation[:, count:]
    steady = np.flatnonzero(np.diag(inside) <= 1e-9)
    inside[steady, steady] = 1.0
    inverse = np.asarray(np.linalg.pinv(inside, hermitian=True), dtype=np.float64)
    slopes = inverse @ across
    explained = np.where(moving, np.clip(np.sum(across * slopes, axis=0), 0.0, 1.0), np.nan)
    srrc = np.where(moving, slopes, np.nan)
    half = -float(ndtri((1.0 - confidence) / 2.0)) * _standard_errors(values, slopes, inverse)
    # For Student's t statistic of a coefficient, the partial correlation is r = t / sqrt(t^2 +
    # freedom). The tail probability is P(|t| > t0) = I_{1 - r^2}(freedom / 2, 1/2).
    own = srrc**2 / np.diag(inverse)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(own > 0.0, (1.0 - explained) / (1.0 - explained + own), 1.0)
    p_value = np.asarray(
        betainc(freedom / 2.0, 0.5, np.where(moving, left, np.nan)), dtype=np.float64
    )
    is_significant = discoveries(p_value, FALSE_DISCOVERY_RATE)
    with np.errstate(invalid="ignore"):
        is_driver = is_significant & (np.abs(srrc) > LEAST_COEFFICIENT)
    residuals = y - x @ slopes
    for k in range(count // 2 if folded is not None else 0):
        pair = [k, k + count // 2]
        for column in np.flatnonzero(is_significant[pair].any(axis=0)).tolist():
            partial = residuals[:, column] + x[:, pair] @ slopes[pair, column]
            errors = [_monotonic_errors(inputs[:, row], partial) for row in pair]
            best = int(np.argmin([error.var() for error in errors]))
            if errors[best].var() <= residuals[:, column].var():
                share = partial.var() - errors[best].var()
                is_named = is_driver[pair, column].any() or share > LEAST_SHARE
                is_driver[pair, column] = is_named & (np.arange(2) == best)
                residuals[:, column] = errors[best]
    together = np.abs(correlation[:, :count])
    np.fill_diagonal(together, 0.0)
    return RankDrivers(
        srrc=srrc,
        srrc_low=srrc - half,
        srrc_high=srrc + half,
        p_value=p_value,
        moves_with=split_partners(is_driver, np.abs(srrc), together, _PARTNERS, _TWINS),
        found=is_driver,
        explained=explained,
        residuals=residuals,
    )


def _monotonic_errors(inputs: Floats, values: Floats) -> Floats:
    """Return the errors of an increasing or decreasing curve, whichever are smaller."""
    from scipy.optimize import isotonic_regression

    order = np.argsort(inputs, kind="stable")
    curves = [isotonic_regression(values[order], increasing=up).x for up in (True, False)]
    errors = values.copy()
    errors[order] -= max(curves, key=np.var)
    return errors


def _standard_errors(values: Floats, slopes: Floats, inverse: Floats) -> Floats:
    """Return the bootstrap standard errors of `slopes`, resampling the flights.

    The resamples are the same for all outputs. For each resample, the ranks are recomputed, and the
    coefficients follow from the coefficients of all flights by one Newton step.
    """
    used, count = min(len(values), _MOST_RESAMPLED), len(slopes)
    columns = values[:used].T
    order = np.argsort(columns, axis=1)
    # first and last positions of equal values in each sorted column
    ends = np.empty((2, *columns.shape), dtype=np.intp)
    for k, (column, sorted_rows) in enumerate(zip(columns, order, strict=True)):
        ends[0, k] = np.searchsorted(column[sorted_rows], column, "left")
        ends[1, k] = np.searchsorted(column[sorted_rows], column, "right")
    ends += (used + 1) * np.arange(len(columns))[:, None]
    draw = np.random.default_rng(0)
    total, squares = np.zeros(slopes.shape), np.zeros(slopes.shape)
    counts = np.zeros((len(columns), used + 1))
    for _ in range(_RESAMPLES):
        weights = np.bincount(draw.integers(used, size=used), minlength=used).astype(np.float64)
        np.cumsum(weights[order], axis=1, out=counts[:, 1:])
        ranks = 0.5 * (counts.take(ends[0]) + counts.take(ends[1]) - used)
        spread = np.sqrt(ranks**2 @ weights / used)
        ranks /= np.where(spread > 0.0, spread, 1.0)[:, None]
        x, y = ranks[:count], ranks[count:]
        step = inverse @ ((x * weights) @ (y.T - x.T @ slopes)) / used
        total += step
        squares += step**2
    variance = (squares - total**2 / _RESAMPLES) / (_RESAMPLES - 1)
    return np.asarray(np.sqrt(variance * used / len(values)), dtype=np.float64)
