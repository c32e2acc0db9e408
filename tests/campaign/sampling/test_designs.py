"""Designs and their correlation by the Gaussian copula."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.campaign.sampling.designs import Design, count_flights, make_copula
from abhv_mc_vehicle.plant.parameters import OURS

# First numbers of seed 2014, atmosphere.density.
PINNED = [0.017774777221241878, 0.20880064504902818]
NAMES = ("atmosphere.density", "aero.lift", "aero.drag")
DRAWN = ["random", "lhs", "sobol", "halton"]


def draw(kind, flights=512, seed=7, names=NAMES, first=0, stop=None, levels=2):
    design = Design(kind, seed, names, flights, levels, OURS)
    return design.draw(first, flights if stop is None else stop)


@pytest.mark.parametrize("kind", DRAWN)
def test_columns_are_uniform(kind):
    numbers = draw(kind, 2000)
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    for column in numbers.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3


@pytest.mark.parametrize("kind", DRAWN)
def test_nothing_moves_flight_k(kind):
    """The range, the number of flights and added parameters do not change flight k."""
    all_flights = draw(kind, 4200)
    for first, stop in ((0, 1), (5, 12), (4090, 4100), (500, 512)):
        np.testing.assert_array_equal(
            draw(kind, 4200, first=first, stop=stop), all_flights[first:stop]
        )
    if kind != "lhs":
        np.testing.assert_array_equal(draw(kind, 300), all_flights[:300])
    extended = draw(
        kind, names=("wind.north", "aero.lift", "mass.total", "aero.drag", "atmosphere.density")
    )
    np.testing.assert_array_equal(extended[:, [4, 1, 3]], draw(kind))


@pytest.mark.parametrize("kind", DRAWN)
def test_neighbouring_seeds_and_parameters_share_nothing(kind):
    columns = np.column_stack([draw(kind, seed=7), draw(kind, seed=8)])
    correlation = np.corrcoef(columns.T) - np.eye(6)
    if kind in (
        "sobol",
        "halton",
    ):  # two scrambles of one dimension are the same net: seeds show in the points only
        correlation = correlation[:3, :3]
    assert np.abs(correlation).max() < 4.0 / np.sqrt(512)  # four standard errors
    assert len(np.unique(columns)) == columns.size


def test_latin_hypercube_has_one_flight_per_slice():
    for column in draw("lhs", 100).T:
        assert sorted(np.floor(column * 100)) == list(range(100))


def test_sobol_fills_every_binary_slice_and_pairs_of_them():
    numbers = draw("sobol", 256)
    for column in numbers.T:
        assert sorted(np.floor(column * 256)) == list(range(256))
    assert (numbers * 2.0**30 % 1.0 == 0.5).all()  # the middles of 2^30 slices
    assert stats.qmc.discrepancy(numbers) < 0.2 * stats.qmc.discrepancy(draw("random", 256))


def test_corners_grid_and_one_at_a_time():
    assert count_flights("corners", 3, 2) == 8 and count_flights("grid", 2, 5) == 25
    assert count_flights("one_at_a_time", 3, 2) == 7 and count_flights("random", 3, 2) is None
    corners = draw("corners", 8)
    assert len(np.unique(corners, axis=0)) == 8 and set(corners.ravel()) == {0.0, 1.0}
    grid = draw("grid", 9, names=NAMES[:2], levels=3)
    np.testing.assert_array_equal(grid[:4], [[0, 0], [0, 0.5], [0, 1], [0.5, 0]])
    varied = draw("one_at_a_time", 7)
    np.testing.assert_array_equal(varied[:4], [[-1, -1, -1], [0, -1, -1], [1, -1, -1], [-1, 0, -1]])


def test_first_numbers_of_a_stream_never_change():
    """Pinned: a change would silently change every existing campaign."""
    np.testing.assert_array_equal(draw("random", 2, seed=2014)[:, 0], PINNED)


CORRELATED = (*NAMES, "mass.total")
PAIRS = {("aero.drag", "aero.lift"): 2 * np.sin(np.pi * 0.7 / 6), ("aero.lift", "mass.total"): -0.4}


def test_correlations_are_those_asked_for_and_laws_and_other_columns_and_bits_of_a_slice_stay():
    numbers, copula = draw("random", 20_000, 5, CORRELATED), make_copula(CORRELATED, PAIRS)
    mixed = copula.apply(numbers)
    np.testing.assert_array_equal(copula.apply(numbers[7:12]), mixed[7:12])
    np.testing.assert_array_equal(mixed[:, 0], numbers[:, 0])
    assert all(stats.kstest(column, "uniform").pvalue > 1e-3 for column in mixed.T)
    ranks = stats.spearmanr(mixed).statistic
    assert ranks[1, 2] == pytest.approx(0.7, abs=0.02)
    assert ranks[1, 3] == pytest.approx(6 / np.pi * np.arcsin(-0.4 / 2), abs=0.02)
    assert abs(ranks[2, 3]) < 0.03
