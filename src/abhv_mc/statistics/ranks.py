"""Ranks and false-discovery control without the slow import of scipy.stats (0.5 s)."""

import numpy as np

from abhv_mc.array_types import Floats, Indices, Mask


def average_ranks(values: Floats) -> Floats:
    """Return ranks from 1 along the first axis of `values`, with ties averaged."""
    columns = values.reshape(len(values), -1).T
    ranks = np.empty(columns.shape)
    for column, row in zip(columns, ranks, strict=True):
        _, inverse, counts = np.unique(column, return_inverse=True, return_counts=True)
        row[:] = (np.cumsum(counts) - 0.5 * (counts - 1))[inverse]
    return ranks.T.reshape(values.shape)


def standard_ranks(values: Floats) -> Floats:
    """Return ranks of each column with zero mean and unit variance; 0 if constant."""
    ranks = average_ranks(values)
    ranks -= ranks.mean(axis=0)
    spread = ranks.std(axis=0)
    return ranks / np.where(spread > 0.0, spread, 1.0)


def false_discovery(p_values: Floats) -> Floats:
    """Return the adjusted p-values [test] of Benjamini and Hochberg (1995)."""
    order = np.argsort(p_values)
    stepped = p_values[order] * (order.size / np.arange(1, order.size + 1))
    corrected = np.empty_like(stepped)
    corrected[order] = np.clip(np.minimum.accumulate(stepped[::-1])[::-1], 0.0, 1.0)
    return corrected


def discoveries(p_values: Floats, rate: float) -> Mask:
    """Return a mask of the discoveries at a false-discovery `rate`; NaN marks untested cases."""
    is_discovery = np.zeros(p_values.shape, bool)
    is_test = np.isfinite(p_values)
    is_discovery[is_test] = false_discovery(p_values[is_test]) <= rate
    return is_discovery


def rank_largest(sizes: Floats) -> list[int]:
    """Return the indices of sizes, largest first; sizes equal to nine decimals keep their order."""
    order: list[int] = np.argsort(-np.nan_to_num(sizes).round(9), kind="stable").tolist()
    return order


def split_partners(
    is_driver: Mask, size: Floats, together: Floats, partners: float, twins: float
) -> Indices:
    """Return the driver [input, output] to which each input is related; -1 for none.

    `together` [input, input] is the similarity of two inputs, zero on the diagonal. An input is
    related to a driver if their similarity is at least `partners`. Of inputs with a similarity of
    at least `twins`, which a regression cannot distinguish, only the input with the largest `size`
    stays in `is_driver` [input, output], which is modified in place.
    """
    moves_with = np.full(is_driver.shape, -1)
    for column in range(is_driver.shape[1]):
        named: list[int] = []
        for row in rank_largest(size[:, column]):
            if is_driver[row, column] and (not named or together[row, named].max() < twins):
                named.append(row)
        is_driver[:, column] = False
        is_driver[named, column] = True
        if named:
            closest = together[:, named].argmax(axis=1)
            near = together[np.arange(len(is_driver)), np.array(named)[closest]] >= partners
            moves_with[:, column] = np.where(
                near & ~is_driver[:, column], np.array(named)[closest], -1
            )
    return moves_with
