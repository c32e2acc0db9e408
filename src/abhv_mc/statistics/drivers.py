"""Which inputs drive an output: standardized rank regression and partial rank correlation.

Both come from the correlation matrix of the ranks (Saltelli et al., "Sensitivity Analysis in Practice", 2004;
Iman & Conover 1979). Intervals are bootstrap percentiles over flights; which inputs count as drivers is decided by
the exact test of a partial correlation under a controlled false-discovery rate over all inputs and outputs.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc
from scipy.stats import false_discovery_control, rankdata

from abhv_mc.statistics.estimates import SEED, Floats

FALSE_DISCOVERY_RATE = 0.005
_FEWEST_SPARE = 10  # flights beyond the number of inputs


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
    found: NDArray[np.bool_]  # drivers, at FALSE_DISCOVERY_RATE over all inputs and outputs
    explained: Floats  # [output] R^2 of the rank regression


def rank_drivers(
    inputs: Floats, outputs: Floats, confidence: float = 0.95, replicates: int = 300
) -> RankDrivers | None:
    """Coefficients of `inputs` [flight, input] on `outputs` [flight, output], infinities allowed in the outputs.

    None where the flights are too few for the number of inputs. Constant inputs get zero coefficients.
    """
    flights, count = inputs.shape
    if flights < count + _FEWEST_SPARE or not count or not outputs.shape[1]:
        return None
    ranks = _standard(np.concatenate([inputs, outputs], axis=1))
    squares = ranks**2
    moving = np.asarray(squares[:, count:].any(axis=0), dtype=np.bool_)
    srrc, prcc, explained = _coefficients(ranks[:, :count].T @ ranks / flights, count, moving)
    draw = np.random.default_rng(SEED)
    spread = np.empty((replicates, 2, count, outputs.shape[1]))
    for row in spread:
        weights = np.bincount(draw.integers(0, flights, flights), minlength=flights).astype(np.float64)
        mean = weights @ ranks / flights
        scale = np.sqrt(np.maximum(weights @ squares / flights - mean**2, 1e-12))
        moment = (ranks[:, :count] * weights[:, None]).T @ ranks / flights - np.outer(mean[:count], mean)
        row[0], row[1], _ = _coefficients(moment / np.outer(scale[:count], scale), count, moving)
    tails = (50.0 * (1.0 - confidence), 50.0 * (1.0 + confidence))
    low, high = np.percentile(spread, tails, axis=0)
    p_value = _partial_p(prcc, flights - count - 1)
    found = np.zeros(p_value.shape, dtype=np.bool_)
    told = np.isfinite(p_value)
    if told.any():
        found[told] = false_discovery_control(p_value[told]) <= FALSE_DISCOVERY_RATE
    flat = np.isnan(srrc)
    low, high = np.where(flat, np.nan, low), np.where(flat, np.nan, high)
    return RankDrivers(srrc, low[0], high[0], prcc, low[1], high[1], p_value, found, explained)


def _standard(columns: Floats) -> Floats:
    """Ranks of each column (ties share theirs) with zero mean and unit variance; constant columns are zero."""
    ranks = rankdata(columns, axis=0)
    ranks -= ranks.mean(axis=0)
    spread = ranks.std(axis=0)
    return ranks / np.where(spread > 0.0, spread, 1.0)


def _coefficients(correlation: Floats, count: int, moving: NDArray[np.bool_]) -> tuple[Floats, Floats, Floats]:
    """SRRC and PRCC [input, output] and R^2 [output] from correlations [input, inputs then outputs].

    Outputs that are not `moving` get NaN.
    """
    inside, across = correlation[:, :count], correlation[:, count:]
    steady = np.flatnonzero(np.diag(inside) <= 1e-9)
    inside = inside.copy()
    inside[steady, steady] = 1.0
    inverse = np.linalg.pinv(inside, hermitian=True)
    srrc = inverse @ across
    explained = np.clip(np.sum(across * srrc, axis=0), 0.0, 1.0)
    # Partial correlation from the regression: b_j scaled by what is left of input j and of the output.
    left = np.sqrt(np.maximum(1.0 - explained, 0.0) + srrc**2 / np.diag(inverse)[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        prcc = np.where(left > 0.0, srrc / np.sqrt(np.diag(inverse))[:, None] / left, 0.0)
    return (
        np.where(moving, srrc, np.nan),
        np.where(moving, np.clip(prcc, -1.0, 1.0), np.nan),
        np.where(moving, explained, np.nan),
    )


def _partial_p(partial: Floats, freedom: int) -> Floats:
    """Two-sided p-value of Student's t for a partial correlation with `freedom` degrees of freedom."""
    square = np.clip(partial**2, 0.0, 1.0)
    # P(|t| > t0) = I_{v/(v+t0^2)}(v/2, 1/2) and v/(v + t0^2) = 1 - r^2
    return np.asarray(betainc(freedom / 2.0, 0.5, 1.0 - square), dtype=np.float64)
