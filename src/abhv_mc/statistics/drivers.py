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
from abhv_mc.statistics.ranks import discoveries, split_partners, standard_ranks

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
    moves_with: NDArray[
        np.intp
    ]  # the driver with which an input that is none is correlated; -1 for none
    explained: Floats  # [output] R^2 of the rank regression
    tells: NDArray[np.bool_]  # [output] whether the regression explains enough to name drivers


def rank_drivers(inputs: Floats, outputs: Floats, confidence: float = 0.95) -> RankDrivers | None:
    """Coefficients of `inputs` [flight, input] on `outputs` [flight, output], infinities allowed in the outputs.

    None where the flights are too few for the number of inputs. Constant inputs get zero coefficients.
    """
    flights, count = inputs.shape
    if flights < count + _FEWEST_SPARE or not count or not outputs.shape[1]:
        return None
    ranks = standard_ranks(np.concatenate([inputs, outputs], axis=1))
    x, y = ranks[:, :count], ranks[:, count:]
    moving = np.asarray(y.any(axis=0), dtype=np.bool_)
    correlation = x.T @ ranks / flights
    inside, across = correlation[:, :count].copy(), correlation[:, count:]
    steady = np.flatnonzero(np.diag(inside) <= 1e-9)
    inside[steady, steady] = 1.0
    inverse = np.asarray(np.linalg.pinv(inside, hermitian=True), dtype=np.float64)
    slopes = inverse @ across
    explained = np.clip(np.sum(across * slopes, axis=0), 0.0, 1.0)
    srrc, prcc = np.where(moving, slopes, np.nan), _partial(slopes, explained, inverse, moving)
    explained = np.where(moving, explained, np.nan)
    with np.errstate(invalid="ignore"):
        residual = y - x @ slopes
        spread = (
            np.sqrt(((x @ inverse) ** 2).T @ residual**2 * flights / (flights - count - 1))
            / flights
        )
    half = -float(ndtri((1.0 - confidence) / 2.0)) * np.where(moving, spread, np.nan)
    low, high = srrc - half, srrc + half
    freedom = flights - count - 1
    # Student's t of a partial correlation: P(|t| > t0) = I_{v/(v+t0^2)}(v/2, 1/2), and v/(v + t0^2) = 1 - r^2
    p_value = np.asarray(
        betainc(freedom / 2.0, 0.5, 1.0 - np.clip(prcc**2, 0.0, 1.0)), dtype=np.float64
    )
    found = discoveries(p_value, FALSE_DISCOVERY_RATE)
    with np.errstate(invalid="ignore"):
        tells = np.asarray(
            1.0 - (1.0 - explained) * (flights - 1.0) / freedom > LEAST_EXPLAINED, dtype=np.bool_
        )
        found &= (np.abs(srrc) > LEAST_COEFFICIENT) & tells
    together = np.abs(correlation[:, :count])
    np.fill_diagonal(together, 0.0)
    moves_with = split_partners(found, np.abs(srrc), together, _PARTNERS, _TWINS)
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


def _partial(srrc: Floats, explained: Floats, inverse: Floats, moving: NDArray[np.bool_]) -> Floats:
    """Partial correlation from the regression: b_j scaled by what is left of input j and of the output."""
    diagonal = np.diag(inverse)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.sqrt(np.maximum(1.0 - explained, 0.0) + srrc**2 / diagonal)
        prcc = np.where(left > 0.0, srrc / np.sqrt(diagonal) / left, 0.0)
    return np.where(moving, np.clip(prcc, -1.0, 1.0), np.nan)
