"""Ranks and discoveries, without scipy.stats: its import costs half a second of every report."""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask


def average_ranks(values: Floats) -> Floats:
    """Ranks from 1 along the first axis of [flight] or [flight, column]; ties share their average."""
    columns = values.reshape(len(values), -1).T
    ranks = np.empty(columns.shape)
    for column, place in zip(columns, ranks, strict=True):
        _, inverse, counts = np.unique(column, return_inverse=True, return_counts=True)
        place[:] = (np.cumsum(counts) - 0.5 * (counts - 1))[inverse]
    return ranks.T.reshape(values.shape)


def standard_ranks(values: Floats) -> Floats:
    """Ranks of each column with zero mean and unit variance; constant columns are zero."""
    ranks = average_ranks(values)
    ranks -= ranks.mean(axis=0)
    spread = ranks.std(axis=0)
    return ranks / np.where(spread > 0.0, spread, 1.0)


def false_discovery(p_values: Floats) -> Floats:
    """Least false discovery rates at which each of these tests [test] is a discovery: Benjamini and Hochberg 1995."""
    order = np.argsort(p_values)
    stepped = p_values[order] * (order.size / np.arange(1, order.size + 1))
    corrected = np.empty_like(stepped)
    corrected[order] = np.clip(np.minimum.accumulate(stepped[::-1])[::-1], 0.0, 1.0)
    return corrected


def discoveries(p_values: Floats, rate: float) -> Mask:
    """Which of these tests are discoveries at a false discovery ``rate`` over all; not-a-number is no test."""
    found = np.zeros(p_values.shape, dtype=np.bool_)
    told = np.isfinite(p_values)
    found[told] = false_discovery(p_values[told]) <= rate
    return found


def split_partners(
    found: Mask, size: Floats, together: Floats, partners: float, twins: float
) -> NDArray[np.intp]:
    """The driver with which each input that is none moves, -1 for none [input, output].

    `together` [input, input] is how closely two go together, zero with itself: from `partners` on one moves with the
    other; of those that do from `twins` on, which nothing tells apart, only the largest in `size` stays `found`.
    """
    moves_with = np.full(found.shape, -1, dtype=np.intp)
    for column in range(found.shape[1]):
        named: list[int] = []
        for row in np.argsort(-np.nan_to_num(size[:, column]), kind="stable").tolist():
            if found[row, column] and (not named or together[row, named].max() < twins):
                named.append(row)
        found[:, column] = False
        found[named, column] = True
        if named:
            closest = together[:, named].argmax(axis=1)
            near = together[np.arange(len(found)), np.array(named)[closest]] >= partners
            moves_with[:, column] = np.where(near & ~found[:, column], np.array(named)[closest], -1)
    return moves_with
