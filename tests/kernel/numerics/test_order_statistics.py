"""Selected ranks are those of sorting everything."""

import numpy as np

from abhv_mc.kernel.numerics.order_statistics import select_ranks


def test_ranks_are_those_of_sorted_values():
    generator = np.random.default_rng(5)
    values = generator.normal(size=(8, 700)).astype(np.float32)
    values[1] = np.round(values[1])  # ties
    values[2] = 3.0
    values[3, ::2] = np.nan
    values[4, :5], values[4, 5:9] = np.inf, -np.inf
    values[5] = np.float32(3e38) * np.tanh(values[5])  # differences overflow
    values[6] = np.cumsum(np.full(700, np.spacing(np.float32(1.0)))) + np.float32(1.0)  # hardly apart
    values[7] = np.nan
    count = np.sum(~np.isnan(values), axis=1)
    ranks = np.array([[0, 1, n // 2, n // 3, n - 1, n - 1] for n in count])
    found = np.full(ranks.shape, np.nan, np.float32)
    select_ranks(values, ranks, found)
    np.testing.assert_array_equal(found[:7], np.take_along_axis(np.sort(values, axis=1), ranks, axis=1)[:7])
    assert np.isnan(found[7]).all()
