"""Check of a rare-event estimate by a second search and importance sampling.

The levels of subset simulation follow the branch along which the severity rises earliest. A branch
along which the severity rises late and steeply is missed, although it may contain more of the
failure probability. Therefore points are drawn far out in random directions; from failing points,
chains move to more likely failures (conditional sampling, as in subset simulation). Random
directions enter a missed branch in 16 % of the trials in 5 dimensions and in 1 % in 20 dimensions.

Importance sampling uses a mixture of normals fitted to all failures by cross-entropy: within a
family of densities, the density closest to the density of the failures has the largest likelihood
for a sample of failures (R.Y. Rubinstein, D.P. Kroese, "The Cross-Entropy Method", 2004; mixtures
of normals for several failure regions: N. Kurtz, J. Song, "Cross-entropy-based adaptive importance
sampling using Gaussian mixture", Structural Safety 42, 2013). The sampled points are independent of
the fitted points.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from abhv_mc.array_types import Floats
from abhv_mc.search.methods.evaluation import LANES, Evaluate, make_generator

# maximum number of dimensions in which the second search was shown to find missed branches
MOST_LOOKED = 10
_PLACE = 1 << 20  # key of the second search's random numbers, larger than the keys of repetitions
_DIRECTIONS, _CHAINS, _LOOK_STEPS = 8 * LANES, 2 * LANES, 24
# distance of the start points beyond the known failures, in standard deviations
_BEYOND = 2.5
_KEPT = 8  # number of points retained from the end of each chain
LOOK_FLIGHTS = _DIRECTIONS + _CHAINS * _LOOK_STEPS

MOST_SAMPLED = 20  # maximum number of dimensions; in more dimensions, importance weights degenerate
# factor on the fitted covariances: proposals with thin tails have infinite variance
_INFLATION = 1.3
_MOST_POINTS = 1000  # maximum number of points to which a mixture is fitted
_MOST_COMPONENTS = 6
_STEPS = 30  # maximum number of steps of a fit
_SETTLED = 1e-3  # increase of the mean log-likelihood below which a fit ends


def find_failures(
    evaluate: Evaluate, dimension: int, threshold: float, probability: float, seed: int
) -> Floats:
    """Return the failures [point, dimension] found by the second search, possibly none.

    The density of these failures is similar to that of the failures found by the first search.
    """
    draw = make_generator(seed, _PLACE)
    directions = draw.standard_normal((_DIRECTIONS, dimension))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    far = directions * (float(-ndtri(probability)) + _BEYOND)
    failed = far[evaluate(far) > threshold]
    if not len(failed):
        return failed
    points = np.resize(failed, (_CHAINS, dimension))
    scale, last_points = 0.5, []
    for step in range(_LOOK_STEPS):
        tried = np.sqrt(1.0 - scale**2) * points + scale * draw.standard_normal(points.shape)
        inside = evaluate(tried) > threshold
        points = np.where(inside[:, None], tried, points)
        scale = float(np.clip(scale * np.exp(inside.mean() - 0.44), 0.05, 0.95))
        if step >= _LOOK_STEPS - _KEPT:
            last_points.append(points)
    return np.concatenate(last_points)


@dataclass(frozen=True)
class Mixture:
    """Mixture of normal densities."""

    weights: Floats  # weights [component]
    means: Floats  # means [component, dimension]
    factors: Floats  # lower Cholesky factors of the covariances [component, dimension, dimension]

    def draw(self, number: int, generator: np.random.Generator) -> Floats:
        """Return random points [point, dimension]."""
        component = generator.choice(len(self.weights), number, p=self.weights)
        noise = generator.standard_normal((number, self.means.shape[1]))
        return self.means[component] + np.einsum("pij,pj->pi", self.factors[component], noise)

    def log_parts(self, points: Floats) -> Floats:
        """Return the logarithms [point, component] of the weighted component densities."""
        parts = np.empty((len(points), len(self.weights)))
        for k, (weight, mean, factor) in enumerate(
            zip(self.weights, self.means, self.factors, strict=True)
        ):
            standard = np.linalg.solve(factor, (points - mean).T)
            parts[:, k] = (
                np.log(weight) - np.log(np.diag(factor)).sum() - 0.5 * (standard**2).sum(axis=0)
            )
        return parts - 0.5 * points.shape[1] * np.log(2.0 * np.pi)


@dataclass(frozen=True)
class ImportanceEstimate:
    """Estimate by importance sampling."""

    probability: float
    cov: float
    effective: float  # effective number of failures
    flights: int


def fit_mixture(points: Floats, components: int, generator: np.random.Generator) -> Mixture:
    """Return a mixture of `components` normal densities, fitted by expectation maximization."""
    number = len(points)
    means = points[[generator.integers(number)]]
    while len(means) < components:  # Starting means are spread out, as in k-means++.
        distance = ((points[:, None, :] - means) ** 2).sum(axis=2).min(axis=1)
        means = np.vstack([means, points[generator.choice(number, p=distance / distance.sum())]])
    nearest = ((points[:, None, :] - means) ** 2).sum(axis=2).argmin(axis=1)
    shares = np.eye(components)[nearest]
    mixture, before = _maximise(points, shares), -np.inf
    for _ in range(_STEPS if components > 1 else 0):
        parts = mixture.log_parts(points)
        density = np.logaddexp.reduce(parts, axis=1)
        mixture = _maximise(points, np.exp(parts - density[:, None]))
        likelihood = float(density.sum())
        if likelihood - before < _SETTLED * number:
            break
        before = likelihood
    return mixture


def _maximise(points: Floats, shares: Floats) -> Mixture:
    """Return the best-fitting normal densities for membership shares [point, component]."""
    dimension = points.shape[1]
    totals = shares.sum(axis=0) + 1e-9
    means = (shares.T @ points) / totals[:, None]
    factors = []
    for k, mean in enumerate(means):
        deviations = points - mean
        covariance = (shares[:, k, None] * deviations).T @ deviations
        # The prior is equivalent to `dimension` additional points with the unit covariance of the
        # inputs.
        covariance = (covariance + dimension * np.eye(dimension)) / (totals[k] + dimension)
        factors.append(np.linalg.cholesky(covariance))
    return Mixture(totals / totals.sum(), means, np.array(factors))


def choose_mixture(points: Floats, seed: int) -> Mixture:
    """Return a widened mixture of 1 to 6 components, chosen by Schwarz's criterion (1978)."""
    distinct = np.unique(points, axis=0)
    if len(distinct) > _MOST_POINTS:
        distinct = distinct[make_generator(seed, 0, 1).permutation(len(distinct))[:_MOST_POINTS]]
    number, dimension = distinct.shape
    least = np.inf
    for components in range(1, _MOST_COMPONENTS + 1):
        free = components * (1 + dimension + dimension * (dimension + 1) / 2)
        if components > 1 and free > number:
            break
        mixture = fit_mixture(distinct, components, make_generator(seed, components))
        criterion = (
            free * np.log(number)
            - 2.0 * np.logaddexp.reduce(mixture.log_parts(distinct), axis=1).sum()
        )
        if criterion >= least:
            break
        best, least = mixture, criterion
    return Mixture(best.weights, best.means, best.factors * np.sqrt(_INFLATION))


def sample_importance(
    evaluate: Evaluate, threshold: float, failures: Floats, flights: int, seed: int
) -> ImportanceEstimate:
    """Return P(severity > `threshold`) from `flights` new points near `failures`.

    `failures` has shape [point, dimension].
    """
    mixture = choose_mixture(failures, seed)
    points = mixture.draw(flights, make_generator(seed, 0))
    failed = evaluate(points) > threshold
    log_normal = -0.5 * (points**2).sum(axis=1) - 0.5 * points.shape[1] * np.log(2.0 * np.pi)
    ratios = np.where(
        failed, np.exp(log_normal - np.logaddexp.reduce(mixture.log_parts(points), axis=1)), 0.0
    )
    mean, squares = float(ratios.mean()), float((ratios**2).sum())
    if mean == 0.0:
        return ImportanceEstimate(0.0, np.inf, 0.0, flights)
    cov = float(ratios.std(ddof=1) / (mean * np.sqrt(flights)))
    return ImportanceEstimate(mean, cov, float(ratios.sum() ** 2 / squares), flights)
