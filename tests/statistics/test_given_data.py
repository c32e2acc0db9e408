"""Indices from flights of any random campaign, against analytic ones and chance."""

import numpy as np
import pytest

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
