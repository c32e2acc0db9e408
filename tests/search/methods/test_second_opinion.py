"""Mixtures of normal densities near failures, against SciPy."""

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal, norm

from abhv_mc.search.methods.evaluation import make_generator
from abhv_mc.search.methods.second_opinion import (
    LOOK_FLIGHTS,
    choose_mixture,
    find_failures,
    fit_mixture,
    sample_importance,
)


def log_density(mixture, points):
    parts = [
        np.log(weight) + multivariate_normal(mean, factor @ factor.T).logpdf(points)
        for weight, mean, factor in zip(*vars(mixture).values(), strict=True)
    ]
    return logsumexp(parts, axis=0)


def test_one_component_has_the_moments_of_its_points_and_a_prior():
    points = np.random.default_rng(1).normal(size=(50, 3)) * [1.0, 2.0, 0.5] + 3.0
    mixture = choose_mixture(np.repeat(points, 2, axis=0), 1)
    assert mixture.weights.tolist() == [1.0]
    assert mixture.means[0] == pytest.approx(points.mean(axis=0), rel=1e-9)
    covariance = 1.3 * (50 * np.cov(points.T, bias=True) + 3 * np.eye(3)) / 53
    np.testing.assert_allclose(mixture.factors[0] @ mixture.factors[0].T, covariance, rtol=1e-9)


def test_the_number_of_components_is_that_of_the_first_least_criterion():
    """Check Schwarz's criterion of 60 points in two groups, closer and closer together."""
    numbers = []
    for distance in np.linspace(2.15, 2.0, 7):
        points = np.random.default_rng(2).normal(size=(60, 2))
        points[::2, 0] += 2.0 * distance
        criteria = []
        for count in (1, 2, 3):
            mixture = fit_mixture(np.unique(points, axis=0), count, make_generator(3, count))
            assert np.logaddexp.reduce(mixture.log_parts(points), axis=1) == pytest.approx(
                log_density(mixture, points)
            )
            free = count - 1 + 2 * count + 3 * count
            criteria.append((free + 1) * np.log(60) - 2.0 * log_density(mixture, points).sum())
        numbers.append(1 + int(np.argmax(np.diff([*criteria, np.inf]) >= 0.0)))
        assert len(choose_mixture(points, 3).weights) == numbers[-1]
    assert {*numbers} == {1, 2}


def test_more_components_than_points_allow_are_not_fitted():
    """Two components of two dimensions have 12 free numbers."""
    groups = np.repeat([[0.0, 0.0], [100.0, 100.0]], 6, axis=0)
    points = groups + np.random.default_rng(4).normal(size=(12, 2))
    assert len(choose_mixture(points, 1).weights) == 2
    assert len(choose_mixture(points[1:], 1).weights) == 1


def test_importance_weights_are_ratios_of_the_normal_to_the_mixture():
    draw = np.random.default_rng(5)
    failures = 0.4 * draw.standard_normal((200, 2)) + [3.0, 0.0]
    seen = []

    def severity(points):
        seen.append(points)
        return points[:, 0]

    result = sample_importance(severity, 2.5, failures, 4000, 7)
    (points,) = seen
    mixture = choose_mixture(failures, 7)
    assert np.array_equal(points, mixture.draw(4000, make_generator(7, 0)))
    ratios = np.exp(norm.logpdf(points).sum(axis=1) - log_density(mixture, points))
    ratios[points[:, 0] <= 2.5] = 0.0
    assert result.probability == pytest.approx(ratios.mean(), rel=1e-9)
    assert result.probability == pytest.approx(norm.sf(2.5), rel=4.0 * result.cov)
    assert result.cov == pytest.approx(ratios.std(ddof=1) / ratios.mean() / 4000**0.5)
    assert result.effective == pytest.approx(ratios.sum() ** 2 / np.sum(ratios**2))
    assert result.flights == 4000
    none = sample_importance(severity, 99.0, failures, 64, 7)
    assert (none.probability, none.cov, none.effective, none.flights) == (0.0, np.inf, 0.0, 64)


def test_the_second_search_begins_beyond_the_known_failures_in_all_directions():
    seen = []

    def severity(points):
        seen.append(points)
        return points[:, 0]

    found = find_failures(severity, 3, 3.0, norm.sf(3.0), 1)
    first, *steps = seen
    assert first.shape == (256, 3) and [len(points) for points in steps] == [64] * 24
    assert np.linalg.norm(first, axis=1) == pytest.approx(np.full(256, 5.5))
    assert first.mean(axis=0) == pytest.approx(np.zeros(3), abs=0.6)
    assert sum(map(len, seen)) == LOOK_FLIGHTS
    assert found.shape == (8 * 64, 3) and found[:, 0].min() > 3.0
    # The chains move to likely failures: x0 is as in the tail of the normal, others are normal.
    assert found[:, 0].mean() == pytest.approx(norm.pdf(3.0) / norm.sf(3.0), abs=0.15)
    assert found[:, 1:].std(axis=0) == pytest.approx([1.0, 1.0], abs=0.3)
    assert np.isin(found, np.concatenate(seen)).all()
    assert find_failures(severity, 3, 9.0, norm.sf(3.0), 1).shape == (0, 3)
