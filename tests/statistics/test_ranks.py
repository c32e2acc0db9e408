"""Ranks, corrected p-values, tails and plain distributions are those of scipy.stats."""

import numpy as np
import pytest
from scipy import stats

from abhv_mc.campaign.sampling.marginals import ContinuousMarginal
from abhv_mc.statistics.failure_drivers import hypergeometric_tail
from abhv_mc.statistics.ranks import average_ranks, false_discovery


def test_as_scipy_has_them():
    draw = np.random.default_rng(1)
    values = draw.integers(0, 40, (300, 4)).astype(float)  # with ties
    assert np.array_equal(average_ranks(values), stats.rankdata(values, axis=0))
    assert np.array_equal(average_ranks(values[:, 0]), stats.rankdata(values[:, 0]))
    p_values = draw.uniform(size=200) ** 4
    np.testing.assert_allclose(false_discovery(p_values), stats.false_discovery_control(p_values), rtol=1e-14)


@pytest.mark.parametrize("table", [(3, 1000, 40, 100), (0, 50, 5, 5), (40, 100_000, 60, 9000), (5, 20, 5, 5)])
def test_hypergeometric_tail(table):
    bad, flights, failures, inside = table
    wanted = stats.hypergeom.sf(bad - 1, flights, failures, inside)
    assert hypergeometric_tail(*table) == pytest.approx(wanted, rel=1e-8)


@pytest.mark.parametrize(("law", "arguments"), [("uniform", (-0.3, 1.7)), ("norm", (0.2, 3.1))])
def test_plain_distributions_have_the_bits_of_scipy(law, arguments):
    ours, theirs = ContinuousMarginal(law, arguments), getattr(stats, law)(*arguments)
    p = np.concatenate([[0.0, 1.0, 2.0**-53], np.random.default_rng(2).uniform(size=1000)])
    x = np.concatenate([theirs.ppf(p[3:]), [-0.3, 1.4, -9.0, 9.0]])
    assert np.array_equal(ours.ppf(p), theirs.ppf(p))
    assert np.array_equal(ours.cdf(x), theirs.cdf(x)) and np.array_equal(ours.density(x), theirs.pdf(x))
    assert ours.frozen.support() == theirs.support()
