"""Quantiles over flights at each time of the recorded histories."""

import numpy as np

from abhv_mc.array_types import Floats, Singles

QUANTILES = (0.00135, 0.05, 0.50, 0.95, 0.99865)


def band_quantiles(values: Singles) -> Floats:
    """Return quantiles [quantile, time] of `values` [time, flight]; NaN without finite values."""
    if values.shape[1] == 0:
        return np.full((len(QUANTILES), len(values)), np.nan)
    last = np.maximum(np.sum(~np.isnan(values), axis=1) - 1, 0)
    ranks = np.array(QUANTILES)[:, None] * last
    floor = np.floor(ranks).astype(np.int64)
    ordered = np.sort(values, axis=1).T  # np.sort puts NaN last.
    lower, upper = (
        np.take_along_axis(ordered, np.minimum(floor + i, last), axis=0) for i in range(2)
    )
    lower = lower.astype(np.float64)
    return lower + (upper - lower) * (ranks - floor)
