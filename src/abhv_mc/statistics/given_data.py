"""Sobol indices estimated from existing flights, without a special design.

First-order indices are estimated by ranks (Gamboa, Gremaud, Klein & Lagnoux, "Global sensitivity
analysis: a novel generation of mighty estimators based on rank statistics", Bernoulli 28, 2022): if
an input determines the output, flights with neighbouring values of the input have similar outputs.
The interaction of two inputs is the variance between the cells of a two-dimensional grid that its
rows and columns do not explain. The total index is the first-order index plus the indices of the
input's significant pairs. If few flights contain most of the variance, as after rare early
terminations, the asymptotic distributions of both statistics do not apply, and significant results
are confirmed by permutations.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr

from abhv_mc.array_types import Floats, Ints
from abhv_mc.statistics.ranks import discoveries, split_partners

FALSE_DISCOVERY_RATE = 0.005
LEAST_SHARE = 0.1  # smallest share of the variance at which an input is reported
FEWEST_FLIGHTS = 200
_CELL = 12  # approximate number of flights in each cell of a pair's grid
_MOST_CELLS = 8  # maximum number of grid cells along each input
_PARTNERS = 0.3  # rank correlation above which two inputs cannot be distinguished
# effective number of flights, by their shares of the variance, below which results are permuted
_SMALL_GROUP = 300.0
_PERMUTATIONS, _BATCH = 5000, 250
_EXCEEDANCES = 10  # number of exceedances at which permutations stop (Besag & Clifford 1991)


@dataclass(frozen=True)
class GivenDataIndices:
    """Shares [input, output] of unit variance; NaN for a constant output."""

    first: Floats  # share due to the input alone
    total: Floats  # share due to the input alone and in pairs
    p_value: Floats  # p-value of the hypothesis that the input has no effect
    # whether each input drives the output, at FALSE_DISCOVERY_RATE over all tests
    found: NDArray[np.bool_]
    # index of the driver with which an input is correlated; -1 for none
    moves_with: NDArray[np.intp]
    # index of the second input in the strongest pair; -1 if pairs add nothing
    partner: NDArray[np.intp]


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
    first = np.zeros((count, y.shape[1]))
    for j in np.flatnonzero(varying).tolist():
        first[j] = _neighbours(y[order[:, j]].T)
    # For unrelated scores, the mean is -1/(n-1) and the variance 1/n (Wald & Wolfowitz 1943).
    p_alone = 1.0 - ndtr((first + 1.0 / (flights - 1)) * np.sqrt(flights))
    for row, column in np.argwhere(2.0 * p_alone <= FALSE_DISCOVERY_RATE).tolist():
        p_alone[row, column] = _confirm(
            p_alone[row, column], first[row, column], y[:, column], _neighbours
        )
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
    moves_with = split_partners(is_driver, total, together, _PARTNERS, _PARTNERS)
    return GivenDataIndices(
        first, total, p_value, is_driver, moves_with, np.where(moving, partner, -1)
    )


def _neighbours(scores: Floats) -> Floats:
    """Return the mean product of neighbours along the last axis of `scores`."""
    return np.asarray(np.mean(scores * np.roll(scores, -1, axis=-1), axis=-1))


def _confirm(
    p_value: float, observed: float, scores: Floats, statistic: Callable[[Floats], Floats]
) -> float:
    """Return the p-value of `observed` by permutation if few flights contain the variance.

    `statistic` maps permuted scores [permutation, flight] to values [permutation]. An asymptotic
    `p_value` that no permutation contradicts is retained.
    """
    if len(scores) ** 2 > _SMALL_GROUP * float((scores**4).sum()):
        return p_value
    draw, tried, exceedances = np.random.default_rng(0), 0, 0
    while tried < _PERMUTATIONS and exceedances < _EXCEEDANCES:
        permuted = draw.permuted(np.tile(scores, (_BATCH, 1)), axis=1)
        exceedances += int((statistic(permuted) >= observed - 1e-12).sum())
        tried += _BATCH
    return exceedances / tried if exceedances else p_value


def _interactions(sums: Floats, size: Floats) -> tuple[Floats, Floats]:
    """Return the variation between cells that rows and columns do not explain, and the rest.

    `sums` [..., cell, cell] and `size` contain the sum of the scores and the number of flights.
    """
    by_row, by_column = sums.sum(axis=-1) / size.sum(axis=-1), sums.sum(axis=-2) / size.sum(axis=-2)
    interaction = sums / size - by_row[..., :, None] - by_column[..., None, :]
    flights = size.sum(axis=(-2, -1))
    remainder = flights - np.sum(sums**2 / size, axis=(-2, -1))
    return np.sum(size * interaction**2, axis=(-2, -1)), np.maximum(remainder, 1e-9 * flights)


def _pairs(
    ranks: NDArray[np.intp], y: Floats, varying: NDArray[np.bool_], together: Floats
) -> tuple[Floats, NDArray[np.intp], Floats]:
    """Return variance shares [input, output] due to pairs, best partners and p-values."""
    flights, count = ranks.shape
    added, p_value = np.zeros((count, y.shape[1])), np.ones((count, y.shape[1]))
    partner, strongest = np.full(added.shape, -1, dtype=np.intp), np.zeros(added.shape)
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
        for k in np.flatnonzero(p_values <= FALSE_DISCOVERY_RATE).tolist():
            ends = np.r_[0, np.cumsum(size[k].astype(np.intp))]

            def statistic(permuted: Floats, ends: Ints = ends, size: Floats = size[k]) -> Floats:
                # Permuted scores are exchangeable, so the cells may be consecutive.
                total = np.pad(np.cumsum(permuted, axis=1), ((0, 0), (1, 0)))[:, ends]
                square, remainder = _interactions(
                    np.diff(total, axis=1).reshape(-1, *size.shape), size
                )
                return square / remainder

            p_values[k] = _confirm(p_values[k], square[k] / remainder[k], y[:, column], statistic)
        p_values = np.minimum(p_values * (count - 1), 1.0)  # Each input is in count - 1 pairs.
        real = p_values <= FALSE_DISCOVERY_RATE
        for input_index, partner_index in ((first, second), (second, first)):
            np.add.at(added[:, column], input_index[real], share[real])
            np.minimum.at(p_value[:, column], input_index, p_values)
            for k in np.flatnonzero(real).tolist():
                if share[k] > strongest[input_index[k], column]:
                    strongest[input_index[k], column], partner[input_index[k], column] = (
                        share[k],
                        partner_index[k],
                    )
    return added, partner, p_value
