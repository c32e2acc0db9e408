"""Tests of Gaussian processes against OpenTURNS, and of estimates by known cases."""

import re

import numpy as np
import openturns as ot
import pytest
from scipy import stats
from scipy.optimize import approx_fprime
from search.methods import known_probabilities as known

from abhv_mc.search.methods import gaussian_process as gp
from abhv_mc.search.methods.subset import SubsetPlan
from abhv_mc.search.methods.surrogate import BATCH, estimate_by_surrogate

GENERATOR = np.random.default_rng(1)
POINTS, NEW = GENERATOR.standard_normal((25, 2)), GENERATOR.standard_normal((6, 2))
VALUES = np.sin(POINTS[:, 0]) + POINTS[:, 1] ** 2


def estimate(case, seed, **options):
    return estimate_by_surrogate(
        case.severity, SubsetPlan(case.dimension, case.threshold, seed), **options
    )


@pytest.mark.parametrize("smooth", [False, True])
def test_the_gradient_is_that_of_the_likelihood(smooth):
    logs = gp.draw_starts(2, 1, np.random.default_rng(3))[0]
    logs[4] = -6.0
    arguments = (POINTS, VALUES, (POINTS[:, None] - POINTS) ** 2, smooth)
    numerical = approx_fprime(logs, lambda x: gp._loss(x, *arguments)[0], 1e-6)
    np.testing.assert_allclose(gp._loss(logs, *arguments)[1], numerical, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("smooth", [False, True])
def test_openturns_predicts_the_same(smooth):
    lengths, variance, nugget = [1.3, 2.1], 1.7, 1e-10
    make = ot.SquaredExponential if smooth else lambda *x: ot.MaternModel(*x, 2.5)
    model = make(lengths, [variance**0.5])
    model.setNuggetFactor(nugget / variance)
    theirs = ot.GaussianProcessRegression(
        ot.Sample(POINTS),
        ot.Sample(VALUES[:, None]),
        model,
        ot.SymbolicFunction(["a", "b"], ["0"]),
    )
    theirs.run()
    result = theirs.getResult()
    covariance = ot.GaussianProcessConditionalCovariance(result).getConditionalCovariance(
        ot.Sample(NEW)
    )
    logs = np.r_[[-40.0] * 3, np.log([variance, nugget, *lengths])]
    ours = gp.condition(POINTS, VALUES, smooth, logs)
    means, sigmas = ours.predict(NEW)
    np.testing.assert_allclose(means, np.asarray(result.getMetaModel()(NEW))[:, 0], atol=1e-7)
    np.testing.assert_allclose(ours.covariance(NEW), np.asarray(covariance), atol=1e-9)
    np.testing.assert_allclose(sigmas**2, np.diag(ours.covariance(NEW)), atol=1e-9)


def test_left_out_values_are_predicted_by_all_others():
    logs = np.r_[[-3.0] * 3, 0.5, -8.0, 0.3, 0.7]
    i = 4
    reduced = gp.condition(np.delete(POINTS, i, 0), np.delete(VALUES, i), False, logs)
    mean, sigma = reduced.predict(POINTS[[i]])
    error = (VALUES[i] - mean[0]) / np.hypot(sigma[0], np.exp(0.5 * logs[4]))
    left_out = gp.condition(POINTS, VALUES, False, logs).left_out()
    assert left_out[i] == pytest.approx(error, rel=1e-6)


def test_right_within_its_interval():
    """Check one seed; benchmarks/others/surrogate.py checks twenty, of more cases."""
    case = known.masked(2)
    result = estimate(case, 11)
    assert result.refusal is None and result.low <= case.probability <= result.high
    assert result.high < 3.0 * result.low and result.flights <= 400
    assert result.steps[-1].failures > 0
    last, before = result.steps[-1], result.steps[-2]
    assert (result.low, result.high, result.flights) == (last.low, last.high, last.runs)
    assert result.probability == pytest.approx(np.mean(last.probabilities))
    assert result.low < min(last.probabilities) and max(last.probabilities) < result.high
    assert result.cov == pytest.approx(np.log(result.high / result.low) / 3.92)
    assert before.low <= last.high and last.low <= before.high
    assert last.runs - before.runs == BATCH
    assert all(step.high <= np.exp(3.92 * 0.2) * step.low for step in (before, last))
    assert (case.severity(result.failures) > case.threshold).mean() > 0.9


@pytest.mark.parametrize(("step", "is_refused"), [(0.5, True), (0.1, True), (0.02, False)])
def test_steps_of_the_metric_widen_the_interval_or_end_the_search(step, is_refused):
    """Intervals of metrics with steps were narrow and entirely below the probability."""

    def severity(u):
        return np.floor(u.sum(axis=1) / 2.0**0.5 / step + 1e-9) * step

    result = estimate_by_surrogate(severity, SubsetPlan(2, 3.5 - 0.01 * step, 5))
    if is_refused:
        assert "steps" in result.refusal and result.flights < 80
    else:
        assert result.refusal is None and result.low <= stats.norm.sf(3.5) <= result.high
    assert result.plain == (0, 20) and result.unwarned_high == pytest.approx(1.0 - 0.05**0.05)


@pytest.mark.thorough
def test_no_estimate_where_neighbours_say_nothing_of_each_other():
    case = known.Case(
        "noise", 2, lambda u: np.sin(1e4 * u[:, 0]) + np.cos(1e4 * u[:, 1]) - 1.0, 0.0, 0.25
    )
    result = estimate(case, 1, runs=64)
    assert re.search(r" 62 .* \d\S* .* \d", result.refusal)  # flights, and the range


def test_the_first_points_are_a_latin_hypercube_of_twice_the_standard_deviation():
    """Twelve points, three more in each dimension, and twenty plain ones."""
    seen = []

    def severity(points):
        seen.append(points)
        return points.sum(axis=1) - 1.0

    estimate_by_surrogate(severity, SubsetPlan(3, 0.0, 4), runs=1)
    (points,) = seen
    assert points.shape == (21 + 20, 3)
    cells = np.floor(21 * stats.norm.cdf(points[:21] / 2.0))
    assert np.sort(cells, axis=0).T.tolist() == 3 * [list(range(21))]
    assert not np.array_equal(cells[:, 0], cells[:, 1])
    assert 0.7 < points[21:].std() < 1.3


def test_an_estimate_does_not_depend_on_the_unit_of_the_metric():
    found = [
        estimate_by_surrogate(
            lambda points, unit=unit: unit * (np.sinh(points[:, 0]) + points[:, 1]),
            SubsetPlan(2, unit * 1.5, 6),
            runs=38,
        )
        for unit in (1.0, 1024.0)
    ]
    numbers = [[own.probability, own.low, own.high] for own in found]
    assert numbers[1] == pytest.approx(numbers[0], rel=0.01)


def test_a_limit_that_all_points_violate_has_the_probability_one():
    result = estimate_by_surrogate(
        lambda points: 2.0 + np.exp(points[:, 0]) + points[:, 1] ** 2,
        SubsetPlan(2, 1.0, 6),
        runs=38,
    )
    assert result.low <= result.probability == pytest.approx(1.0, abs=0.1) and result.high == 1.0
    assert result.steps[-1].failures == result.flights and result.plain == (20, 20)
