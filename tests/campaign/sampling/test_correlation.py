"""The Gaussian copula: the correlation asked for, the marginals kept, no flight moved."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.campaign.sampling.correlation import make_copula, normal_correlation
from abhv_mc.campaign.sampling.designs import Design

NAMES = ("atmosphere.density", "aero.lift", "aero.drag", "mass.total")
PAIRS = {("aero.drag", "aero.lift"): normal_correlation(0.7), ("aero.lift", "mass.total"): -0.4}


@pytest.fixture(scope="module")
def numbers():
    return Design("random", 5, NAMES, 20000).draw(0, 20000)


def test_correlations_are_those_asked_for(numbers):
    mixed = make_copula(NAMES, PAIRS).apply(numbers)
    ranks = stats.spearmanr(mixed).statistic
    assert ranks[1, 2] == pytest.approx(0.7, abs=0.02)
    assert ranks[1, 3] == pytest.approx(6 / np.pi * np.arcsin(-0.4 / 2), abs=0.02)
    assert abs(ranks[2, 3]) < 0.03


def test_laws_stay_uniform_and_other_columns_untouched(numbers):
    mixed = make_copula(NAMES, PAIRS).apply(numbers)
    np.testing.assert_array_equal(mixed[:, 0], numbers[:, 0])
    for column in mixed.T:
        assert stats.kstest(column, "uniform").pvalue > 1e-3


def test_a_slice_is_the_whole_cut_to_the_bit(numbers):
    copula = make_copula(NAMES, PAIRS)
    np.testing.assert_array_equal(copula.apply(numbers)[7:12], copula.apply(numbers[7:12]))


def test_a_matrix_that_is_not_positive_definite_is_refused():
    impossible = {("aero.drag", "aero.lift"): 0.9, ("aero.lift", "mass.total"): 0.9, ("aero.drag", "mass.total"): -0.9}
    with pytest.raises(np.linalg.LinAlgError):
        make_copula(NAMES, impossible)
