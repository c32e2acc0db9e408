"""Ranks and corrected p-values: two functions of scipy.stats, whose import costs half a second of every report."""

import numpy as np

from abhv_mc.array_types import Floats


def average_ranks(values: Floats) -> Floats:
    """Ranks from 1 along the first axis of [flight] or [flight, column]; ties share their average."""
    columns = values.reshape(len(values), -1).T
    ranks = np.empty(columns.shape)
    for column, place in zip(columns, ranks, strict=True):
        _, inverse, counts = np.unique(column, return_inverse=True, return_counts=True)
        place[:] = (np.cumsum(counts) - 0.5 * (counts - 1))[inverse]
    return ranks.T.reshape(values.shape)


def false_discovery(p_values: Floats) -> Floats:
    """Least false discovery rates at which each of these tests [test] is a discovery: Benjamini and Hochberg 1995."""
    order = np.argsort(p_values)
    stepped = p_values[order] * (order.size / np.arange(1, order.size + 1))
    corrected = np.empty_like(stepped)
    corrected[order] = np.clip(np.minimum.accumulate(stepped[::-1])[::-1], 0.0, 1.0)
    return corrected
