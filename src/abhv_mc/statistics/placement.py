"""Comparison of test flights with simulated flights by ranks and simultaneous bands.

If a test flight is another draw from the simulated distribution, the test flight and the n
simulated flights are exchangeable. Then p-values from ranks among all flights, or from ranks of
statistics of these ranks, are exact for any n. The band uses split conformal prediction with
leave-one-out scores
(Lei, G'Sell, Rinaldo, Tibshirani & Wasserman, JASA 113, 2018; Diquigiovanni, Fontana & Vantini,
"Conformal prediction bands for multivariate functional data", J. Multivariate Anal. 189, 2022).
"""

from collections.abc import Iterator, Sequence
from math import ceil, inf
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Indices

CONFIDENCE = 0.95
# smallest distance of a quantile from the median, as a share of the channel's largest standard
# deviation
_FLOOR = 0.05
_TAIL = 0.025  # share of flights beyond the pointwise band on each side
# minimum number of simulated flights with a value at a time, for the band to be computed at this
# time
_FEWEST = 10
# spread, relative to a channel's size, below which differences are rounding errors: two steps of
# the single precision of stored histories
_ROUNDING = 2.0**-22
_RIDGE = 1e-3  # regularization relative to a column's unit variance


def rank_p_values(pool: Floats) -> Floats:
    """Return the two-sided p-value of each rank [flight, column] within its column."""
    from scipy.stats import rankdata

    at_most, least = (rankdata(pool, method, axis=0) for method in ("max", "min"))
    return np.minimum(2.0 * np.minimum(at_most, len(pool) + 1.0 - least) / len(pool), 1.0)


class SetTest(NamedTuple):
    """P-values of a set of test flights among simulated sets of flights."""

    columns: Floats  # [flight, column] two-sided p-value of each value, for a single test
    flights: Floats  # [flight] p-value of each flight, corrected for the number of flights
    together: float  # p-value of the whole set


def judge_set(pool: Floats, scores: Floats | float = 0.0) -> SetTest:
    """Compare the last set of `pool` [set, flight, column] with all other, simulated sets.

    Flight k of each set has the same conditions. Missing values (NaN) count as medians. `scores`
    [set, flight] are additional deviations, such as those of histories from a band. Sets that are
    draws from one model are exchangeable, so the p-values, which are ranks among the sets of
    symmetric statistics, are exact.

    The deviation of a flight is the smallest p-value of its columns, of its Mahalanobis distance
    and of its score. Its p-value is the share of sets whose largest deviation is at least as large.
    The deviation of a set is the smallest p-value of: means and mean squares of normal scores, the
    Mahalanobis distance of the means, the mean Mahalanobis distance, products of two columns
    (correlations), and the largest deviation of a flight.
    """
    from scipy.special import ndtri
    from scipy.stats import rankdata

    sets, flights, columns = pool.shape
    pool = np.where(np.isfinite(pool).any(axis=0), pool, 0.0)
    middle, spread = np.nanmean(pool, axis=0), np.nanstd(pool, axis=0)
    spread += _ROUNDING * np.abs(middle) + np.finfo(float).tiny
    flat = np.nan_to_num(np.round((pool - middle) / spread, 6)).reshape(-1, columns)
    normal = ndtri((rankdata(flat, axis=0) - 0.5) / len(flat)).reshape(pool.shape)
    p_values = rank_p_values(flat)
    distances = _distances(normal.reshape(-1, columns))
    added = np.broadcast_to(scores, pool.shape[:2]).ravel()
    deviations = [-p_values.min(axis=1), distances, added]
    least = np.min([_shares(values) for values in deviations], axis=0).reshape(sets, flights)
    first = least.min(axis=1)
    own = normal - normal.mean(axis=1, keepdims=True) * (flights > 2)
    covariances = own.swapaxes(1, 2) @ own / flights
    factor = np.linalg.inv(np.linalg.cholesky(covariances.mean(axis=0) + _RIDGE * np.eye(columns)))
    ratios = factor @ covariances @ factor.T
    losses = (
        np.trace(ratios, axis1=1, axis2=2)
        - np.linalg.slogdet(flights * ratios + np.eye(columns)).logabsdet
    )
    means, squares = normal.mean(axis=1), (normal**2).mean(axis=1)
    statistics = [_largest(means), _largest(squares), _distances(means), losses, -first]
    shares = np.array([_shares(np.round(values, 9)) for values in statistics])
    joint = shares.min(axis=0) + shares.sum(axis=0) / (1e3 * sets)  # The sum separates ties.
    return SetTest(
        columns=p_values[-flights:],
        flights=np.mean(first <= least[-1][:, None] + 1e-12, axis=1),
        together=float(np.mean(joint <= joint[-1] + 1e-12)),
    )


def _shares(values: Floats) -> Floats:
    """Return, for each value, the share of all values that are at least as large."""
    return 1.0 - np.searchsorted(np.sort(values), values, "left") / len(values)


def _distances(pool: Floats) -> Floats:
    """Return squared Mahalanobis distances [flight] of `pool` [flight, column]."""
    values = (pool - pool.mean(axis=0)) / (pool.std(axis=0) + np.finfo(float).tiny)
    covariance = values.T @ values / len(pool) + _RIDGE * np.eye(values.shape[1])
    solved = np.linalg.solve(covariance, values.T)
    # Without rounding, flights with equal values would differ.
    return np.round(np.einsum("fc,cf->f", values, solved), 9)


def _largest(values: Floats) -> Floats:
    """Return the largest standardized magnitude [set] of `values` [set, column]."""
    spread = values.std(axis=0) + np.finfo(float).tiny
    return np.abs((values - values.mean(axis=0)) / spread).max(axis=1, initial=0.0)


class Band(NamedTuple):
    """Simultaneous band that contains a whole new history with probability `confidence`.

    A spread is the distance from the median to the 2.5 or 97.5 % quantile of the flights at a time:
    the band is the pointwise band, widened about the median by a single factor.
    """

    middle: Floats  # centre of the band [time, channel]
    spread: Floats  # [side, time, channel], below and above; NaN if too few flights have a value
    # distance of the edges from the middle, in spreads; infinite if flights are too few
    factor: float
    scores: Floats  # largest deviation of each simulated flight from all other flights, in spreads

    @property
    def edges(self) -> tuple[Floats, Floats]:
        """Lower and upper edge of the band [time, channel]."""
        below, above = self.factor * self.spread
        return self.middle - below, self.middle + above

    def deviations(self, history: Floats) -> Floats:
        """Return a history's deviations [time, channel] in units of the spread; 0 if missing."""
        deviations = history - self.middle
        return np.nan_to_num(np.maximum(-deviations / self.spread[0], deviations / self.spread[1]))


def simultaneous_band(histories: Floats, confidence: float = CONFIDENCE) -> Band:
    """Return the band of `histories` [flight, time, channel]; NaN after a flight's end."""
    flights, times, channels = histories.shape
    middle, spread = np.empty((times, channels)), np.empty((2, times, channels))
    scores = np.zeros(flights)
    for channel in range(channels):
        values = histories[:, :, channel]
        ends, others = _quantiles(values, (_TAIL, 0.5, 1.0 - _TAIL))
        middle[:, channel] = center = ends[1, 0]
        judged = np.isfinite(center)
        largest = np.nanstd(values[:, judged], axis=0, ddof=1).max(initial=0.0)
        size = _ROUNDING * np.abs(center[judged]).max(initial=0.0) + np.finfo(float).tiny
        widths, own = (
            np.maximum(np.diff(sides, axis=0), max(_FLOOR * largest, size))
            for sides in (ends, others)
        )
        spread[:, :, channel] = widths[:, 0]
        deviations = Band(others[1], own, inf, scores).deviations(values)
        scores = np.maximum(scores, deviations.max(axis=1))
    rank = ceil(confidence * (flights + 1))
    factor = inf if rank > flights else float(np.partition(scores, rank - 1)[rank - 1])
    return Band(middle, spread, factor, scores)


def _quantiles(values: Floats, shares: Sequence[float]) -> Iterator[Floats]:
    """Yield quantiles [share, 1, column], and those without each flight [share, flight, column].

    `values` [flight, column] are NaN if missing; the result is NaN if there are too few.
    """
    ordered, count = np.sort(values, axis=0)[np.newaxis], np.isfinite(values).sum(axis=0)

    def order(index: Indices) -> Floats:
        return np.take_along_axis(ordered, index, axis=1)

    def order_of_others(index: Indices) -> Floats:
        own = order(index)
        return np.where(values <= own, order(index + 1), own)

    for find, number in ((order, count), (order_of_others, count - 1)):
        rank = np.multiply.outer(shares, number - 1.0)[:, np.newaxis]
        low, high = (find(rank.astype(np.intp) + step) for step in range(2))
        yield np.where(count < _FEWEST, np.nan, low + rank % 1.0 * (high - low))


_SHIFTS = 41  # number of shifts that are tried
_SIGNIFICANT = 25.0  # smallest significant reduction of the sum of squares, in noise variances


def find_offset(simulated: Floats, record: Floats, span: float, modes: int) -> tuple[float, bool]:
    """Return the shift of `record` [time, channel] in samples, and whether it is significant.

    The shift minimizes the mean squared deviation from the mean of `simulated`
    [flight, time, channel] that the first principal `modes` of the simulated flights do not
    explain, so that dispersed parameters do not look like an offset. `span` is the largest shift as
    a share of the samples. A shift is significant if it reduces the deviation by more than for any
    simulated flight. Channels that are the same in all simulated flights are not used.
    """
    simulated = np.where(np.isfinite(simulated).any(axis=0), simulated, 0.0)
    middle, spread = np.nanmean(simulated, axis=0), np.nanstd(simulated, axis=0)
    varied = spread.max(axis=0) > _ROUNDING * np.abs(middle).max(axis=0)
    varied &= np.isfinite(record).any(axis=0)
    if not varied.any():
        return 0.0, False
    simulated, record = simulated[..., varied], record[:, varied]
    middle, spread = middle[:, varied], spread[:, varied]
    spread = np.maximum(spread, _FLOOR * spread.max(axis=0) + np.finfo(float).tiny)
    deviations = np.nan_to_num((simulated - middle) / spread).reshape(len(simulated), -1)
    directions = np.linalg.svd(deviations, full_matrices=False)[2][:modes]
    directions = directions.reshape(-1, *record.shape)
    flights = np.concatenate([simulated, record[None]])
    most = max(1, round(span * len(record)))
    shifts = np.unique(np.linspace(-most, most, _SHIFTS).astype(np.int64))
    losses = np.empty((len(shifts), len(flights)))
    for row, shift in enumerate(shifts.tolist()):
        own = slice(max(0, -shift), len(record) - max(0, shift))
        moved = np.roll(flights, -shift, axis=1)[:, own]
        valid = np.isfinite(moved[-1])
        values = np.nan_to_num((moved - middle[own]) / spread[own])[:, valid]
        basis, _ = np.linalg.qr(directions[:, own][:, valid].T)
        losses[row] = np.mean((values - values @ basis @ basis.T) ** 2, axis=1)
    gains = losses[len(shifts) // 2] - losses.min(axis=0)
    best = int(np.clip(losses[:, -1].argmin(), 1, len(shifts) - 2))
    near = shifts[best - 1 : best + 2]
    curvature, slope, _ = np.polyfit(near, losses[best - 1 : best + 2, -1], 2)
    offset = np.clip(-slope / max(2.0 * curvature, np.finfo(float).tiny), near[0], near[2])
    noise = _SIGNIFICANT / valid.sum() * losses[:, -1].min()
    return float(offset), bool(gains[-1] > max(noise, gains[:-1].max()))
