"""Which inputs drive an output: standardized rank regression and partial rank correlation.

Both come from the correlation matrix of the ranks (Saltelli et al., "Sensitivity Analysis in Practice", 2004;
Iman & Conover 1979). Intervals allow for errors of unequal spread (White 1980). An input is named as a driver only
where the regression explains most of the output, where its coefficient is large, and where its partial correlation
passes the exact test under a controlled false-discovery rate over all inputs and outputs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, ndtri

from abhv_mc.array_types import Floats
from abhv_mc.statistics.ranks import average_ranks, false_discovery

FALSE_DISCOVERY_RATE = 0.005
LEAST_COEFFICIENT = 0.2  # of a driver
LEAST_EXPLAINED = 0.5  # R^2 of a regression that names drivers, adjusted for the number of inputs
_FEWEST_SPARE = 10  # flights beyond the number of inputs
_PARTNERS = 0.3  # rank correlation from which an input moves with a driver
_TWINS = 0.9  # rank correlation from which a regression does not tell two inputs apart


@dataclass(frozen=True)
class RankDrivers:
    """Rank coefficients of inputs on outputs; arrays are [input, output]; a constant output has NaN."""

    srrc: Floats
    srrc_low: Floats
    srrc_high: Floats
    prcc: Floats
    prcc_low: Floats
    prcc_high: Floats
    p_value: Floats  # of PRCC = 0
    found: NDArray[np.bool_]  # drivers
    moves_with: NDArray[np.intp]  # the driver with which an input that is none is correlated; -1 for none
    explained: Floats  # [output] R^2 of the rank regression
    tells: NDArray[np.bool_]  # [output] whether the regression explains enough to name drivers


def rank_drivers(inputs: Floats, outputs: Floats, confidence: float = 0.95) -> RankDrivers | None:
    """Coefficients of `inputs` [flight, input] on `outputs` [flight, output], infinities allowed in the outputs.

    None where the flights are too few for the number of inputs. Constant inputs get zero coefficients.
    """
    flights, count = inputs.shape
    if flights < count + _FEWEST_SPARE or not count or not outputs.shape[1]:
        return None
    ranks = _standard(np.concatenate([inputs, outputs], axis=1))
    x, y = ranks[:, :count], ranks[:, count:]
    moving = np.asarray(y.any(axis=0), dtype=np.bool_)
    correlation = x.T @ ranks / flights
    srrc, prcc, explained, inverse = _coefficients(correlation, count, moving)
    with np.errstate(invalid="ignore"):
        residual = y - x @ np.nan_to_num(srrc)
        spread = np.sqrt(((x @ inverse) ** 2).T @ residual**2 * flights / (flights - count - 1)) / flights
    half = -float(ndtri((1.0 - confidence) / 2.0)) * np.where(moving, spread, np.nan)
    low, high = srrc - half, srrc + half
    freedom = flights - count - 1
    p_value = _partial_p(prcc, freedom)
    found = np.zeros(p_value.shape, dtype=np.bool_)
    told = np.isfinite(p_value)
    if told.any():
        found[told] = false_discovery(p_value[told]) <= FALSE_DISCOVERY_RATE
    with np.errstate(invalid="ignore"):
        tells = np.asarray(1.0 - (1.0 - explained) * (flights - 1.0) / freedom > LEAST_EXPLAINED, dtype=np.bool_)
        found &= (np.abs(srrc) > LEAST_COEFFICIENT) & tells
    moves_with = _split_twins(found, srrc, correlation[:, :count])
    return RankDrivers(
        srrc,
        low,
        high,
        prcc,
        _partial(low, explained, inverse, moving),
        _partial(high, explained, inverse, moving),
        p_value,
        found,
        moves_with,
        explained,
        tells,
    )


def _split_twins(found: NDArray[np.bool_], srrc: Floats, correlation: Floats) -> NDArray[np.intp]:
    """The driver with which each input that is none moves, -1 for none [input, output].

    Of two inputs that go together so closely that no regression tells them apart the smaller stops being `found`.
    """
    together = np.abs(correlation)
    np.fill_diagonal(together, 0.0)
    moves_with = np.full(found.shape, -1, dtype=np.intp)
    for column in range(found.shape[1]):
        named: list[int] = []
        for row in np.argsort(-np.abs(np.nan_to_num(srrc[:, column])), kind="stable").tolist():
            if found[row, column] and (not named or together[row, named].max() < _TWINS):
                named.append(row)
        found[:, column] = False
        found[named, column] = True
        if named:
            closest = together[:, named].argmax(axis=1)
            near = together[np.arange(len(found)), np.array(named)[closest]] >= _PARTNERS
            moves_with[:, column] = np.where(near & ~found[:, column], np.array(named)[closest], -1)
    return moves_with


def _standard(columns: Floats) -> Floats:
    """Ranks of each column (ties share theirs) with zero mean and unit variance; constant columns are zero."""
    ranks = average_ranks(columns)
    ranks -= ranks.mean(axis=0)
    spread = ranks.std(axis=0)
    return ranks / np.where(spread > 0.0, spread, 1.0)


def _coefficients(correlation: Floats, count: int, moving: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats, Floats]:
    """SRRC and PRCC [input, output], R^2 [output] and the inverse correlation of the inputs.

    From correlations [input, inputs then outputs]. Outputs that are not `moving` get NaN.
    """
    inside, across = correlation[:, :count].copy(), correlation[:, count:]
    steady = np.flatnonzero(np.diag(inside) <= 1e-9)
    inside[steady, steady] = 1.0
    inverse = np.asarray(np.linalg.pinv(inside, hermitian=True), dtype=np.float64)
    srrc = inverse @ across
    explained = np.clip(np.sum(across * srrc, axis=0), 0.0, 1.0)
    prcc = _partial(srrc, explained, inverse, moving)
    return np.where(moving, srrc, np.nan), prcc, np.where(moving, explained, np.nan), inverse


def _partial(srrc: Floats, explained: Floats, inverse: Floats, moving: NDArray[np.bool_]) -> Floats:
    """Partial correlation from the regression: b_j scaled by what is left of input j and of the output."""
    diagonal = np.diag(inverse)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.sqrt(np.maximum(1.0 - explained, 0.0) + srrc**2 / diagonal)
        prcc = np.where(left > 0.0, srrc / np.sqrt(diagonal) / left, 0.0)
    return np.where(moving, np.clip(prcc, -1.0, 1.0), np.nan)


def _partial_p(partial: Floats, freedom: int) -> Floats:
    """Two-sided p-value of Student's t for a partial correlation with `freedom` degrees of freedom."""
    square = np.clip(partial**2, 0.0, 1.0)
    # P(|t| > t0) = I_{v/(v+t0^2)}(v/2, 1/2) and v/(v + t0^2) = 1 - r^2
    return np.asarray(betainc(freedom / 2.0, 0.5, 1.0 - square), dtype=np.float64)
