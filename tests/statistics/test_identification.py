"""Tests of the estimation of parameters and spreads, against closed forms."""

import numpy as np
import pytest

from abhv_mc.statistics.identification import estimate, find_spread

TIME = np.linspace(0.0, 5.0, 40)


def fit(slopes, data, **options):
    """Estimate the coordinates of the linear model `slopes` [column, output]."""
    columns, outputs = slopes.shape
    arguments = {
        "sigma": np.ones(outputs),
        "channels": np.zeros(outputs, int),
        "vehicles": np.arange(len(data)),
        "shared": np.ones(columns, bool),
        "listed": np.arange(columns) < 2,
    } | options
    keywords = {name: arguments.pop(name) for name in ("shared", "listed")}
    return estimate(lambda points: points @ slopes, data, *arguments.values(), **keywords)


def test_a_linear_model_has_the_estimates_of_least_squares_with_priors():
    draw = np.random.default_rng(1)
    slopes, data = draw.standard_normal((3, 40)), 3.0 * draw.standard_normal((2, 40))
    sigma = np.linspace(0.5, 2.0, 40)
    data[0, 5:9] = np.nan
    result = fit(slopes, data, sigma=sigma)
    for row, values, errors in zip(data, result.points, result.errors, strict=True):
        valid = np.isfinite(row)
        own = slopes[:, valid] / sigma[valid]
        covariance = np.linalg.inv(own @ own.T + np.diag([0.0, 0.0, 1.0]))
        assert values == pytest.approx(covariance @ own @ (row[valid] / sigma[valid]), rel=1e-4)
        assert errors == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-4)
    assert result.freedom == 76 - 4 and result.converged and not result.inseparable


def test_a_bent_model_converges_with_the_error_of_its_tangent():
    def simulate(points):  # Steps of Gauss-Newton from 0 overshoot beyond +-30.
        return 100.0 * np.arctan(4.0 * (points - 2.0)) * np.ones(30)

    data = simulate(np.array([[[2.1]]]))[0]
    flags = {"shared": np.ones(1, bool), "listed": np.ones(1, bool)}
    result = estimate(simulate, data, np.ones(30), np.zeros(30, int), np.zeros(1, int), **flags)
    assert result.converged and result.points[0, 0] == pytest.approx(2.1, abs=1e-4)
    tangent = 400.0 / (1.0 + 0.4**2) * 30.0**0.5
    assert result.errors[0, 0] == pytest.approx(1.0 / tangent, rel=0.02)


def test_flights_of_a_vehicle_share_parameters():
    draw = np.random.default_rng(2)
    slopes, truth = draw.standard_normal((2, 40)), np.array([[4.0, 0.5], [4.0, -1.0], [-3.0, 0.0]])
    data = truth @ slopes + draw.standard_normal((3, 40))
    shared, listed = np.array([True, False]), np.array([True, False])
    result = fit(slopes, data, vehicles=np.array([0, 0, 2]), shared=shared, listed=listed)
    assert result.points[0, 0] == result.points[1, 0] != result.points[2, 0]
    assert result.errors[0, 0] == pytest.approx(result.errors[2, 0] / 2.0**0.5, rel=0.1)
    assert result.points == pytest.approx(truth, abs=0.6)


def test_parameters_that_cannot_be_separated_are_not_estimated():
    draw = np.random.default_rng(3)
    slopes = draw.standard_normal((4, 40))
    slopes[2], slopes[3] = 0.7 * slopes[0], 0.0
    data = np.array([[1.0, 2.0, 0.0, 0.0]]) @ slopes + draw.standard_normal((1, 40))
    result = fit(slopes, data, listed=np.ones(4, bool))
    groups = dict(result.inseparable)
    assert groups.keys() == {(0, 2), (3,)} and groups[0, 2] == pytest.approx(-1.0, abs=0.01)
    assert result.listed.tolist() == [False, True, False, False]
    assert abs(result.points[0, 1] - 2.0) < 3.0 * result.errors[0, 1]


def test_coverage_misfit_and_estimated_noise_of_a_nonlinear_model():
    draw = np.random.default_rng(4)

    def simulate(points):
        rate, size, offset = np.moveaxis(points[..., np.newaxis], -2, 0)
        return 10.0 * (1.0 + 0.1 * size) * np.exp(-0.3 * (1.0 + 0.1 * rate) * TIME) + 0.2 * offset

    truth = draw.standard_normal((400, 3)) * [3.0, 3.0, 1.0]
    data = simulate(truth) + 0.2 * draw.standard_normal((400, 40))
    arguments = (np.zeros(40, int), np.arange(400))
    flags = {"shared": np.ones(3, bool), "listed": np.array([True, True, False])}
    for sigma in (0.2, np.nan):
        result = estimate(simulate, data, np.full(40, sigma), *arguments, **flags)
        inside = np.abs(result.points - truth) < 1.96 * result.errors
        assert inside.mean(axis=0) == pytest.approx([0.95] * 3, abs=0.03)
        assert result.sigma == pytest.approx(np.full(40, 0.2), rel=0.05)
        assert result.p_value > 0.01
        other = data + 0.3 * np.sin(3.0 * TIME)
        assert estimate(simulate, other, np.full(40, sigma), *arguments, **flags).p_value < 1e-3


def test_the_spread_is_that_of_restricted_maximum_likelihood():
    draw = np.random.default_rng(5)
    errors = draw.uniform(0.1, 1.0, 12)
    estimates = 3.0 + 0.8 * draw.standard_normal(12) + errors * draw.standard_normal(12)
    mean, error, spread = find_spread(estimates, errors)
    grid = np.linspace(0.0, 3.0, 3001)[:, np.newaxis]
    weights = 1.0 / (grid**2 + errors**2)
    means = (weights @ estimates / weights.sum(axis=1))[:, np.newaxis]
    losses = np.log(weights.sum(axis=1)) + np.sum(
        weights * (estimates - means) ** 2 - np.log(weights), axis=1
    )
    best = int(np.argmin(losses))
    assert (mean, spread) == pytest.approx((means[best, 0], grid[best, 0]), abs=2e-3)
    assert error == pytest.approx(weights[best].sum() ** -0.5, rel=1e-2)
    assert find_spread(np.full(5, 2.0), np.ones(5))[2] == 0.0
