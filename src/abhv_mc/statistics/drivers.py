"""Standardized rank regression and Sobol indices, which identify inputs that drive an output.

The coefficients come from the correlation matrix of the ranks (Saltelli et al., "Sensitivity
Analysis in Practice", 2004; Iman & Conover 1979). Their intervals are bootstrapped. The ranks are
recomputed for each resample, because the coefficients depend on them. An input is a driver if its
coefficient is large and significant at a controlled false-discovery rate over all inputs and
outputs. Effects are not linear in ranks if many outputs are equal, so monotonic curves replace the
terms of inputs whose monotonic curve fits at least as well (isotonic regression).

First-order indices are estimated by ranks (Gamboa, Gremaud, Klein & Lagnoux, "Global sensitivity
analysis: a novel generation of mighty estimators based on rank statistics", Bernoulli 28, 2022): if
an input determines the output, flights with neighbouring values of the input have similar outputs.
The interaction of two inputs is the variance between the cells of a two-dimensional grid that its
rows and columns do not explain. The total index is the first-order index plus the indices of the
input's significant pairs. If few flights contain most of the variance, as after rare early
terminations, the p-values of significant pairs are counted in permutations, because the asymptotic
distribution does not apply.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.special import betainc, chdtrc, ndtr, ndtri

from abhv_mc.array_types import Floats, Indices, Mask
from abhv_mc.statistics.ranks import discoveries, split_partners, standard_ranks

FALSE_DISCOVERY_RATE = 0.005
LEAST_SHARE = 0.1  # smallest share of the variance at which an input is reported
FEWEST_FLIGHTS = 200
_CELL = 12  # approximate number of flights in each cell of a pair's grid
_MOST_CELLS = 8  # maximum number of grid cells along each input
_PARTNERS = 0.3  # rank correlation above which two inputs cannot be distinguished
# effective number of flights, by their shares of the variance, below which scores are permuted
_SMALL_GROUP = 300.0
_PERMUTATIONS = 5000
# number of permutations in each block, and of flights above which a block has one, to save memory
_BLOCK, _BLOCK_FLIGHTS = 100, 10_000
_EXCEEDANCES = 10  # number of exceedances at which permutations stop (Besag & Clifford 1991)


class GivenDataIndices(NamedTuple):
    """Shares [input, output] of unit variance; NaN for a constant output."""

    first: Floats  # share due to the input alone
    total: Floats  # share due to the input alone and in pairs
    # whether each input drives the output, at FALSE_DISCOVERY_RATE over all tests
    found: Mask
    # index of the second input in the strongest pair; -1 if pairs add nothing
    partner: Indices


def given_data_indices(inputs: Floats, scores: Floats) -> GivenDataIndices | None:
    """Return the Sobol indices of `inputs` for `scores`; None if there are too few flights.

    `inputs` has shape [flight, input]. `scores` [flight, output] are standardized ranks or their
    residuals, with zero mean; their variance is the sum of all shares. At least FEWEST_FLIGHTS
    flights are needed. The shares of constant inputs are zero.
    """
    flights, count = inputs.shape
    if flights < FEWEST_FLIGHTS or not count or not scores.shape[1]:
        return None
    spread = scores.std(axis=0)
    moving = spread > 1e-6
    y = np.where(moving, scores / np.where(moving, spread, 1.0), 0.0)
    order = np.argsort(inputs, axis=0, kind="stable")
    ranks = np.argsort(order, axis=0)
    varying = np.ptp(inputs, axis=0) > 0.0
    first, p_alone = np.zeros((count, y.shape[1])), np.ones((count, y.shape[1]))
    for j in np.flatnonzero(varying).tolist():
        along = y[order[:, j]]
        products = along * np.roll(along, -1, axis=0)
        first[j] = products.mean(axis=0)
        # For unrelated scores, the mean is -1/(n-1) and the variance 1/n (Wald & Wolfowitz 1943),
        # or more if few flights contain most of the variance.
        deviation = np.sqrt(np.maximum(np.mean(products**2, axis=0), 1.0) / flights)
        p_alone[j] = 1.0 - ndtr((first[j] + 1.0 / (flights - 1)) / deviation)
    together = np.abs(np.corrcoef(ranks.T)) if count > 1 else np.ones((1, 1))
    np.fill_diagonal(together, 0.0)
    added, partner, p_pair = _pairs(ranks, y, varying, together)
    p_value = np.where(
        moving & varying[:, None], np.minimum(2.0 * np.minimum(p_alone, p_pair), 1.0), np.nan
    )
    first = np.where(moving, np.maximum(first, 0.0), np.nan) * spread**2
    total = np.minimum(first + added * spread**2, spread**2)
    is_driver = discoveries(p_value, FALSE_DISCOVERY_RATE)
    with np.errstate(invalid="ignore"):
        is_driver &= total > LEAST_SHARE
    split_partners(is_driver, total, together, _PARTNERS, _PARTNERS)
    return GivenDataIndices(first, total, is_driver, np.where(moving, partner, -1))


def _interactions(sums: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Return the variation between cells that rows and columns do not explain, and within cells.

    `sums` [..., cell, cell] and `size` contain the sum of the scores and the number of flights.
    """
    by_row, by_column = sums.sum(axis=-1) / size.sum(axis=-1), sums.sum(axis=-2) / size.sum(axis=-2)
    interaction = sums / size - by_row[..., :, None] - by_column[..., None, :]
    inside = size - sums**2 / size
    least = 1e-9 * size.sum(axis=(-2, -1))
    return np.sum(size * interaction**2, axis=(-2, -1)), np.maximum(
        inside.sum(axis=(-2, -1)), least
    )


def _pairs(
    ranks: Indices, y: Floats, varying: Mask, together: Floats
) -> tuple[Floats, Indices, Floats]:
    """Return variance shares [input, output] due to pairs, best partners and p-values."""
    flights, count = ranks.shape
    added, p_value = np.zeros((count, y.shape[1])), np.ones((count, y.shape[1]))
    partner, strongest = np.full(added.shape, -1), np.zeros(added.shape)
    cells = int(np.clip(np.sqrt(flights / _CELL), 2, _MOST_CELLS))
    bins = ranks * cells // flights
    # A grid separates the effects of two inputs only if the inputs are nearly independent.
    usable = np.flatnonzero(varying)
    pairs = [
        (i, j) for n, i in enumerate(usable) for j in usable[n + 1 :] if together[i, j] < _PARTNERS
    ]
    if not pairs:
        return added, partner, p_value
    marks = np.zeros((flights, count * cells))
    np.put_along_axis(marks, np.arange(count) * cells + bins, 1.0, axis=1)
    numbers = (marks.T @ marks).reshape(count, cells, count, cells)
    first, second = np.array(pairs).T
    size = np.maximum(numbers[first, :, second, :], 1e-9)  # flights in each cell [pair, cell, cell]
    freedom = (cells - 1) ** 2
    for column in range(y.shape[1]):
        sums = (marks.T @ (marks * y[:, [column]])).reshape(count, cells, count, cells)[
            first, :, second, :
        ]
        square, remainder = _interactions(sums, size)
        variance = remainder / (flights - cells**2)
        share = np.maximum(square - freedom * variance, 0.0) / flights
        p_values = chdtrc(freedom, square / variance)
        is_small = np.mean(y[:, column] ** 4) * _SMALL_GROUP > flights
        few = np.flatnonzero(is_small & (p_values <= FALSE_DISCOVERY_RATE))
        places = bins[:, first[few]] * cells + bins[:, second[few]]
        at_least = square[few] / remainder[few] - 1e-12
        counted = _permute(places.T, y[:, column], size[few], at_least)
        p_values[few] = np.where(counted > 0.0, counted, p_values[few])
        p_values = np.minimum(p_values * (count - 1), 1.0)  # Each input is in count - 1 pairs.
        real = p_values <= FALSE_DISCOVERY_RATE
        for input_index, partner_index in ((first, second), (second, first)):
            np.add.at(added[:, column], input_index[real], share[real])
            np.minimum.at(p_value[:, column], input_index, p_values)
            for k in np.flatnonzero(real).tolist():
                if share[k] > strongest[input_index[k], column]:
                    strongest[input_index[k], column] = share[k]
                    partner[input_index[k], column] = partner_index[k]
    return added, partner, p_value


def _permute(cells: Indices, y: Floats, sizes: Floats, at_least: Floats) -> Floats:
    """Return the share of permutations whose interactions are ``at_least`` as large, by pair.

    If there are none, the asymptotic p-value is smaller than can be counted. ``cells`` [pair,
    flight] and ``sizes`` [pair, cell, cell] describe the grids.
    """
    draw, number = np.random.default_rng(0), sizes[:1].size
    tried, exceedances = np.zeros(len(cells)), np.zeros(len(cells), int)
    block = _BLOCK if len(y) <= _BLOCK_FLIGHTS else 1
    offsets = number * np.arange(block)[:, None]
    while len(rest := np.flatnonzero((tried < _PERMUTATIONS) & (exceedances < _EXCEEDANCES))):
        permuted = np.stack([draw.permutation(y) for _ in offsets]).ravel()
        for k in rest.tolist():
            sums: Any = np.bincount((offsets + cells[k]).ravel(), permuted, number * block)
            ratios = np.divide(*_interactions(sums.reshape(-1, *sizes[k].shape), sizes[k]))
            exceeding = np.flatnonzero(ratios >= at_least[k])[: _EXCEEDANCES - exceedances[k]]
            exceedances[k] += len(exceeding)
            tried[k] += exceeding[-1] + 1 if exceedances[k] == _EXCEEDANCES else block
    return exceedances / tried


LEAST_COEFFICIENT = 0.2  # smallest absolute coefficient of a driver
_FEWEST_SPARE = 10  # minimum excess of the number of flights over the number of inputs
_TWINS = 0.9  # rank correlation above which a regression cannot distinguish two inputs
_RESAMPLES = 300
# maximum number of resampled flights; standard errors are scaled to the number of all flights
_MOST_RESAMPLED = 1000


class RankDrivers(NamedTuple):
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
    moving = y.any(axis=0)
    correlation = x.T @ ranks / flights
    inside, across = correlation[:, :count].copy(), correlation[:, count:]
    steady = np.flatnonzero(np.diag(inside) <= 1e-9)
    inside[steady, steady] = 1.0
    inverse = np.linalg.pinv(inside, hermitian=True)
    slopes = inverse @ across
    explained = np.where(moving, np.clip(np.sum(across * slopes, axis=0), 0.0, 1.0), np.nan)
    srrc = np.where(moving, slopes, np.nan)
    half = -float(ndtri((1.0 - confidence) / 2.0)) * _standard_errors(values, slopes, inverse)
    # For Student's t statistic of a coefficient, the partial correlation is r = t / sqrt(t^2 +
    # freedom). The tail probability is P(|t| > t0) = I_{1 - r^2}(freedom / 2, 1/2).
    own = srrc**2 / np.diag(inverse)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.where(own > 0.0, (1.0 - explained) / (1.0 - explained + own), 1.0)
    p_value = betainc(freedom / 2.0, 0.5, np.where(moving, left, np.nan))
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
    return np.sqrt(variance * used / len(values))
