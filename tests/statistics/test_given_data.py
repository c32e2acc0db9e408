"""Indices from flights of any random campaign, against analytic ones and chance."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.statistics.drivers import given_data_indices
from abhv_mc.statistics.ranks import standard_ranks

FLIGHTS = 1000


def indices_of(inputs, outputs):
    return given_data_indices(inputs, standard_ranks(outputs))


def draw_inputs(seed, count=8, flights=FLIGHTS):
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (flights, count))


def test_a_wave_is_found_and_a_product_by_its_pair():
    """sin(6x): no rank correlation, all of the variance; x0 x2: neither has a share of its own."""
    for seed in range(20):
        inputs = draw_inputs(seed, 20)
        indices = indices_of(
            inputs, np.column_stack([np.sin(6.0 * inputs[:, 4]), inputs[:, 0] * inputs[:, 2]])
        )
        assert [np.flatnonzero(column).tolist() for column in indices.found.T] == [[4], [0, 2]]
        assert indices.first[4, 0] > 0.9 and indices.partner[[0, 2], 1].tolist() == [2, 0]
        assert indices.first[[0, 2], 1].max() < 0.15 and indices.total[[0, 2], 1].min() > 0.5


def test_shares_are_the_analytic_ones():
    """Check a sum of two uniforms and one of their products.

    Ranks of a symmetric output change the shares little.
    """
    inputs = draw_inputs(200, 4, 20_000)
    indices = indices_of(inputs, (2.0 * inputs[:, 0] + inputs[:, 1])[:, None])
    assert indices.first[:, 0] == pytest.approx([0.8, 0.2, 0.0, 0.0], abs=0.04)
    assert indices.total[:, 0] == pytest.approx(indices.first[:, 0], abs=0.03)


def test_shares_of_residuals_are_in_units_of_the_whole_variance():
    inputs = draw_inputs(9, 3, 2000)
    y = standard_ranks(np.column_stack([inputs[:, 0] * inputs[:, 1], np.sin(6.0 * inputs[:, 2])]))
    whole, part = given_data_indices(inputs, y), given_data_indices(inputs, y * [0.8, 0.2])
    factors = [0.64, 0.04]
    assert part.first == pytest.approx(whole.first * factors)
    assert part.total == pytest.approx(whole.total * factors)
    assert whole.total[0, 0] > whole.first[0, 0] + 0.5
    assert whole.found.T.tolist() == [[True, True, False], [False, False, True]]
    assert part.found.T.tolist() == [[True, True, False], [False] * 3]  # less than a tenth
    assert part.partner.tolist() == whole.partner.tolist()


def test_nothing_is_named_where_nothing_drives():
    named = 0
    for seed in range(60):
        noise = np.random.default_rng(300 + seed).standard_t(3, size=(400, 1))
        named += indices_of(draw_inputs(600 + seed, 12, 400), noise).found.any()
    assert named <= 3


@pytest.mark.parametrize("together", [0.5, 0.9])
def test_an_idle_partner_of_a_driver_is_not_named(together):
    named = 0
    for seed in range(25):
        normal = np.random.default_rng(900 + seed).normal(size=(FLIGHTS, 6))
        normal[:, 1] = together * normal[:, 0] + np.sqrt(1.0 - together**2) * normal[:, 1]
        indices = indices_of(normal, np.sin(3.0 * normal[:, [0]]) + normal[:, [3]])
        assert indices.found[[0, 3], 0].all()
        named += indices.found[[1, 2, 4, 5], 0].any()
    assert named <= 2


def test_lost_flights_are_the_worst_and_constants_are_left_out():
    inputs = draw_inputs(1000, 3)
    inputs[:, 2] = 1.0
    output = np.column_stack([np.where(inputs[:, 0] > 0.5, np.inf, inputs[:, 1]), np.ones(FLIGHTS)])
    indices = indices_of(inputs, output)
    assert indices.found[:, 0].tolist() == [True, True, False]
    assert np.isnan(indices.first[:, 1]).all() and not indices.found[:, 1].any()
    assert indices_of(inputs[:100], output[:100]) is None


def test_rare_failures_at_one_end_of_an_input_are_found():
    """A twentieth of the flights contains the variance, so that scores of neighbours vary more."""
    inputs = draw_inputs(7, 4, 400)
    rare = inputs[:, [2]] >= np.sort(inputs[:, 2])[-20]
    assert np.flatnonzero(indices_of(inputs, rare.astype(float)).found).tolist() == [2]


def test_two_rare_failures_in_one_cell_are_no_pair():
    """Two flights fall into the same one of 64 cells by chance more often than is allowed."""
    inputs, rare = draw_inputs(8, 3), np.zeros((FLIGHTS, 1))
    rare[np.argsort(inputs[:, 0] + inputs[:, 1])[[-1, -3]]] = 1.0
    assert indices_of(inputs, rare).partner.max() == -1


def runs_of_signs(total, runs):
    """Return `total` positive and as many negative signs in `runs` runs of each, alternating."""
    sizes = total // runs + (np.arange(runs) < total % runs)
    return np.repeat(np.resize([1.0, -1.0], 2 * runs), np.repeat(sizes, 2))


PAIRS = np.repeat([[1, 1, 0], [-1, -1, 0], [1, -1, 0]], [32, 32, 36], axis=0).ravel()


@pytest.mark.parametrize(
    ("sequence", "first", "found"),
    [
        # The limit is 2.807 standard deviations above the mean -1/207 of unrelated flights.
        (runs_of_signs(104, 42), 40 / 208, True),
        (runs_of_signs(104, 43), 36 / 208, False),
        # Half of the flights contain the variance: the standard deviation is (2/300)**0.5.
        (np.r_[runs_of_signs(75, 30), np.zeros(150)], 2 * 31 / 300, False),
        (np.r_[runs_of_signs(75, 25), np.zeros(150)], 2 * 51 / 300, True),
        # The mean square of the products is 0.75, but the standard deviation at least 300**-0.5.
        (PAIRS, 1.5 * 28 / 300, False),
    ],
)
def test_the_share_of_an_input_is_the_correlation_of_neighbours(sequence, first, found):
    places = np.random.default_rng(3).permutation(len(sequence))
    indices = given_data_indices(places[:, None].astype(float), 1.0 * sequence[places, None])
    share = sequence.var()
    assert indices.first.item() == pytest.approx(first * share, abs=1e-12)
    assert indices.total.item() == pytest.approx(first * share, abs=1e-12)
    assert indices.found.item() is found and indices.partner.item() == -1


def vary_in_cells(places, y, cells):
    """Return the share of a pair's interaction in unit variance, and its p-value without others."""
    flights = len(y)
    row, column = places * cells // flights
    rows, columns = (np.bincount(own, y) / np.bincount(own) for own in (row, column))
    cell = row * cells + column
    sizes = np.bincount(cell, minlength=cells**2)
    means = np.bincount(cell, y, cells**2) / np.maximum(sizes, 1)
    between = (sizes * (means - (rows[:, None] + columns).ravel()) ** 2).sum()
    variance = np.sum((y - means[cell]) ** 2) / (flights - cells**2)
    freedom = (cells - 1) ** 2
    share = (between - freedom * variance) / flights
    return share, stats.chi2.sf(between / variance, freedom)


@pytest.mark.parametrize(("flights", "cells"), [(432, 6), (586, 6), (1400, 8)])
def test_the_share_of_a_pair_is_its_interaction_in_cells_of_twelve_flights(flights, cells):
    """The part of the flights that follow a product grows."""
    draw = np.random.default_rng(5)
    places = np.stack([draw.permutation(flights) for _ in range(2)])
    product = np.sign(np.prod(places + 0.5 - flights / 2, axis=0))
    noise, mixed, found = np.resize([1.0, -1.0], flights), draw.random(flights), []
    for part in np.linspace(0.1, 0.6, 26):
        y = np.where(mixed < part, product, draw.permutation(noise))
        y = (y - y.mean()) / y.std()
        share, p_value = vary_in_cells(places, y, cells)
        indices = given_data_indices(places.T.astype(float), y[:, None])
        added = share if p_value <= 0.005 else 0.0
        assert indices.total[:, 0] == pytest.approx(indices.first[:, 0] + added, abs=1e-9)
        assert indices.partner[:, 0].tolist() == ([1, 0] if added else [-1, -1])
        found.append(added > 0.0)
    assert {*found} == {True, False}
