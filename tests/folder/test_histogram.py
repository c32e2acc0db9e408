"""Envelopes in fixed memory: exact ends, bounded errors between them, no order."""

import numpy as np
import pytest

from abhv_mc.folder.envelopes import QUANTILES
from abhv_mc.folder.histogram import BINS, KEPT, Histograms, make_bins

CELLS = 6


def draw(flights, seed=1):
    """Normal, skewed, two-humped, constant, far from zero, and partly not a number."""
    random = np.random.default_rng(seed)
    values = np.empty((flights, CELLS))
    values[:, 0] = random.normal(size=flights)
    values[:, 1] = random.exponential(size=flights)
    values[:, 2] = random.normal(size=flights) + 10.0 * (random.random(flights) < 0.3)
    values[:, 3] = 7.0
    values[:, 4] = 20000.0 + 0.5 * random.normal(size=flights)
    values[:, 5] = np.where(random.random(flights) < 0.5, np.nan, random.normal(size=flights))
    values[0, 5] = 0.5
    return values.astype(np.float32)


def collect(values, size, order=1):
    histograms = Histograms(*make_bins(values[:128]))
    for first in list(range(0, len(values), size))[::order]:
        histograms.add(values[first : first + size])
    return histograms


def wanted(values):
    columns = [column[~np.isnan(column)].astype(float) for column in values.T]
    return np.array([np.quantile(column, QUANTILES) for column in columns]).T


@pytest.mark.parametrize("flights", [3, 100, 1000, 20000])
def test_against_numpy(flights):
    values = draw(flights)
    table = collect(values, 64).table(1, CELLS)
    np.testing.assert_array_equal(table.count[0], np.sum(~np.isnan(values), axis=0))
    np.testing.assert_array_equal(table.low[0], np.nanmin(values, axis=0))
    np.testing.assert_array_equal(table.high[0], np.nanmax(values, axis=0))
    error = np.abs(table.quantiles[:, 0] - wanted(values))
    np.testing.assert_allclose(table.quantiles[[0, 4], 0], wanted(values)[[0, 4]], rtol=1e-12)  # the tails are exact
    assert (error <= table.error[0] + 1e-12).all()
    if flights <= 2 * KEPT:
        assert table.error.max() == 0.0
    # What the bound is worth: a few thousandths of the width of the whole.
    assert (table.error[0, :3] <= 2.5 * np.ptp(values[:128, :3], axis=0) / BINS).all()


def test_tail_quantiles_are_exact_to_a_hundred_thousand_flights():
    values = draw(100_000)[:, :2]
    histograms = Histograms(*make_bins(values[:128]))
    histograms.add(values)
    table = histograms.table(1, 2)
    exact = np.array([np.quantile(column.astype(float), QUANTILES) for column in values.T]).T
    np.testing.assert_allclose(table.quantiles[[0, 4], 0], exact[[0, 4]], rtol=1e-12)
    assert (np.abs(table.quantiles[:, 0] - exact) <= table.error[0]).all()


@pytest.mark.parametrize(("size", "order"), [(7, 1), (256, -1), (5000, 1)])
def test_order_and_block_size_change_nothing(size, order):
    values = draw(5000)
    one, two = collect(values, 64), collect(values, size, order)
    np.testing.assert_array_equal(one.counts, two.counts)
    np.testing.assert_array_equal(one.tails(), two.tails())


def test_merging_equals_counting_together():
    values = draw(4000)
    bins = make_bins(values[:128])
    parts = [Histograms(*bins) for _ in range(2)]
    parts[0].add(values[:150])
    parts[1].add(values[150:])
    parts[0].merge(parts[1].counts, parts[1].tails())
    parts[0].add(values[:0])
    whole = collect(values, 64)
    np.testing.assert_array_equal(parts[0].counts, whole.counts)
    np.testing.assert_array_equal(parts[0].tails(), whole.tails())


def test_values_outside_the_bins_are_bounded_by_the_kept_extremes():
    """Pilot flights that say nothing about the rest: the error grows, and says so."""
    random = np.random.default_rng(4)
    values = np.concatenate([np.zeros((128, 1)), random.normal(size=(20000, 1))]).astype(np.float32)
    table = collect(values, 64).table(1, 1)
    assert (np.abs(table.quantiles[:, 0] - wanted(values)) <= table.error[0] + 1e-12).all()
    assert table.error[0, 0] > 0.1
