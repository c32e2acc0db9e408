"""Rare-event probability from hundreds of flights, by active learning of a surrogate.

B. Echard, N. Gayton, M. Lemaire, "AK-MCS", Structural Safety 33 (2011); candidates by subset
simulation: M. Moustapha, S. Marelli, B. Sudret, "Active learning for structural reliability",
Structural Safety 96 (2022). Candidates are drawn by importance sampling near all points at which
flights may fail. The next points to evaluate are those that most reduce the misclassified weight of
the candidates: J. Bect, D. Ginsbourger, L. Li, V. Picheny, E. Vazquez, "Sequential design of
computer experiments for the estimation of a probability of failure", Statistics and Computing 22
(2012).
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import counted
from abhv_mc.search.methods.evaluation import Evaluate, make_generator
from abhv_mc.search.methods.gaussian_process import (
    GaussianProcess,
    condition,
    draw_starts,
    fit_process,
)
from abhv_mc.search.methods.rare import RareEstimate
from abhv_mc.search.methods.second_opinion import Mixture, choose_mixture, find_failures
from abhv_mc.search.methods.subset import SubsetPlan, run_subset

MOST_DIMENSIONS = 10
FEWEST_RUNS = 80
BATCH = 8  # number of runs that are evaluated in parallel
_PLACE = 1 << 23  # key of the random numbers
# number of points in the first design: constant part, and points per dimension
_FIRST, _FIRST_OF_DIMENSION = 12, 3
PLAIN = 20  # number of plain Monte Carlo flights that follow the first design
# number of values nearest to the limit at which the step of a metric is measured, and number of
# consecutive batches after which a metric with large steps is rejected
_LEVELS, _STEPPED = 10, 3
# standard deviation of the first design, larger than 1 because failures are far from the mean
_FIRST_SPREAD = 2.0
# number of starting points of the first fit; later fits start at the last optimum and at one other
# point
_STARTS = 3
# growth factor of the number of runs after which the Gaussian processes are refitted
_REFIT = 1.1
# numbers of chains and repetitions of subset simulation on the Gaussian processes
_CHAINS, _REPETITIONS = 64, 4
_CANDIDATES, _MOST_CANDIDATES = 2000, 32_000
_FAILING = 400.0  # required effective number of failing candidates
_JOINT = 300  # number of candidates from which points are selected
_SIGMAS = 1.96
_TINY = 1e-10  # smallest variance in a denominator
# weight of the additional normal distributions, and the factor on their width
_TAILS, _WIDER = 0.3, 1.6
_HEAVY = 1.5  # factor on the sampling error, because most samples miss the largest weights
# Severities are clipped at this multiple of the median distance from failure in the first batch.
_LARGEST = 30.0


@dataclass(frozen=True)
class Step:
    """Estimate after a batch of flights."""

    runs: int
    failures: int  # number of runs that failed
    probabilities: tuple[float, ...]  # probability estimated by each fit
    low: float
    high: float


@dataclass(frozen=True)
class SurrogateEstimate(RareEstimate):
    """Estimate from candidates classified by Gaussian processes."""

    steps: tuple[Step, ...]
    candidates: Floats  # sample of the points that the fits predict to fail [point, dimension]
    plain_failures: int

    @property
    def plain(self) -> tuple[int, int]:
        """Failure and flight counts of the plain Monte Carlo flights."""
        return self.plain_failures, PLAIN

    @property
    def failures(self) -> Floats:
        """Candidates at which a failure is predicted."""
        return self.candidates


@dataclass(frozen=True)
class _Candidates:
    """Points drawn by importance sampling, with the predictions of the fits."""

    points: Floats
    # standard normal density divided by the sampling density and the sample size [point]
    weights: Floats
    means: Floats  # mean predicted by each fit [fit, point]
    sigmas: Floats  # standard deviation predicted by each fit [fit, point]

    def chance(self, margins: Floats) -> tuple[float, float]:
        """Return the weight of positive margins [point] and its coefficient of variation."""
        weights = np.where(margins > 0.0, self.weights, 0.0)
        total, number = float(weights.sum()), len(weights)
        if total == 0.0:
            return 0.0, np.inf
        return total, _HEAVY * float(
            np.sqrt(max(0.0, (weights**2).sum() / total**2 - 1.0 / number))
        )

    @property
    def effective(self) -> float:
        """Smallest effective number of failing candidates over all fits."""
        failing = np.where(self.means > 0.0, self.weights, 0.0)
        squares = (failing**2).sum(axis=1)
        return float(np.min(failing.sum(axis=1) ** 2 / np.where(squares > 0.0, squares, np.inf)))


def estimate_by_surrogate(
    evaluate: Evaluate,
    plan: SubsetPlan,
    target_cov: float = 0.2,
    runs: int = 400,
) -> SurrogateEstimate:
    """Return P(severity > threshold) for standard normal points, with a 95 % interval.

    The severity must be a smooth function of the point. The search has converged if two consecutive
    intervals overlap and are not wider than the interval of a normally distributed estimate with
    the coefficient of variation `target_cov`. The estimate is rejected if convergence takes more
    than `runs` evaluations or if no evaluated flight failed. If severities have steps, the interval
    extends from one step above to one step below the threshold; the estimate is rejected if this
    alone is too wide in consecutive batches.
    """
    key, dimension = (plan.seed, _PLACE), plan.dimension
    number = _FIRST + _FIRST_OF_DIMENSION * dimension
    generator = make_generator(*key, 0)
    points = _spread_points(number, dimension, generator)
    points = np.vstack([points, generator.standard_normal((PLAIN, dimension))])
    severities = evaluate(points) - plan.threshold
    fits: list[GaussianProcess] = []
    steps: list[Step] = []
    fitted = narrow_steps = wide_steps = 0
    widest = np.exp(2.0 * _SIGMAS * target_cov)
    # ratio of the probabilities one step below and above the threshold, without sampling error
    widest_step = widest / np.exp(2.0 * _SIGMAS * _HEAVY / np.sqrt(_FAILING))
    while True:
        generator = make_generator(*key, len(points))
        values, shift = _scale(severities, number)
        is_last = len(points) + BATCH > runs
        if narrow_steps or is_last or len(points) >= _REFIT * fitted:
            fits = _fit(points, values, fits, generator)
            fitted = len(points)
        else:
            fits = [condition(points, values, fit.smooth, fit.logs) for fit in fits]
        candidates = _draw_candidates(fits, plan, generator, shift, narrow_steps > 0 or is_last)
        step = _judge(candidates, severities, shift)
        steps.append(step)
        is_narrow = step.failures > 0 and step.high <= widest * step.low
        overlaps = narrow_steps > 0 and step.low <= steps[-2].high and steps[-2].low <= step.high
        narrow_steps = (2 if overlaps else 1) if is_narrow else 0
        is_stepped = all(
            candidates.chance(mean + shift)[0] > widest_step * candidates.chance(mean - shift)[0]
            for mean in candidates.means
        )
        wide_steps = wide_steps + 1 if is_stepped else 0
        if narrow_steps == 2 or wide_steps == _STEPPED or is_last:
            break
        batch = _choose(fits, candidates, generator)
        points = np.vstack([points, batch])
        severities = np.r_[severities, evaluate(batch) - plan.threshold]
    refusal = None
    if wide_steps == _STEPPED:
        refusal = (
            "the metric has large steps: one step below and above the limit, the fits range from "
            f"{step.low:.1g} to {step.high:.1g}"
        )
    elif not step.failures:
        refusal = f"none of the {counted(step.runs, 'flight')} failed"
    elif narrow_steps < 2:
        refusal = (
            f"not converged after {counted(step.runs, 'flight')}: the last fits range from "
            f"{step.low:.1g} to {step.high:.1g}"
        )
    middle = float(np.mean(step.probabilities))
    cov = float(np.log(step.high / step.low) / (2.0 * _SIGMAS)) if step.low > 0.0 else np.inf
    failing = np.where(candidates.means.mean(axis=0) > 0.0, candidates.weights, 0.0)
    picked = (
        candidates.points[generator.choice(len(failing), 1000, p=failing / failing.sum())]
        if failing.any()
        else points[:0]
    )
    return SurrogateEstimate(
        probability=middle,
        low=step.low,
        high=step.high,
        cov=cov,
        flights=len(points),
        repetitions=(),
        check=None,
        refusal=refusal,
        steps=tuple(steps),
        candidates=picked,
        plain_failures=int((severities[number : number + PLAIN] > 0.0).sum()),
    )


def _fit(
    points: Floats, values: Floats, previous: list[GaussianProcess], generator: np.random.Generator
) -> list[GaussianProcess]:
    """Return a Matern and a smooth process, fitted from the last optimum and random starts."""
    fits = []
    for i, smooth in enumerate((False, True)):
        starts = draw_starts(points.shape[1], 1 if previous else _STARTS, generator)
        if previous:
            starts = np.vstack([previous[i].logs, starts])
        fits.append(fit_process(points, values, smooth, starts))
    return fits


def _spread_points(number: int, dimension: int, generator: np.random.Generator) -> Floats:
    """Return a Latin hypercube [point, dimension] of normal numbers with enlarged variance."""
    from scipy.special import ndtri

    ranks = np.argsort(generator.random((number, dimension)), axis=0)
    uniform = (ranks + generator.random((number, dimension))) / number
    return np.asarray(_FIRST_SPREAD * ndtri(np.clip(uniform, 1e-9, 1.0 - 1e-9)))


def _scale(severities: Floats, first: int) -> tuple[Floats, float]:
    """Return dimensionless severities [point], and their step near zero if any are equal, or 0.

    The scale is linear near zero and logarithmic elsewhere.
    """
    inside = -severities[:first][severities[:first] < 0.0]
    scaled = severities / (np.median(inside) if inside.size else 1.0)
    levels = np.unique(scaled.round(9))
    near = np.sort(levels[np.argsort(np.abs(levels))[:_LEVELS]])
    step = float(np.diff(near).min()) if 1 < len(levels) < len(scaled) else 0.0
    values = np.arcsinh(np.clip(scaled, -_LARGEST, _LARGEST))
    spread = float(values.std()) or 1.0
    return values / spread, float(np.arcsinh(step)) / spread


def _predict(fits: list[GaussianProcess], points: Floats) -> tuple[Floats, Floats]:
    """Return means [fit, point], and standard deviations inflated by cross-validation."""
    predicted = [fit.predict(points) for fit in fits]
    return np.array([mean for mean, _ in predicted]), np.array(
        [fit.inflation * sigma for fit, (_, sigma) in zip(fits, predicted, strict=True)]
    )


def _draw_candidates(
    fits: list[GaussianProcess],
    plan: SubsetPlan,
    generator: np.random.Generator,
    shift: float,
    many: bool,
) -> _Candidates:
    """Return candidates near all points at which a fit's upper bound exceeds -`shift`.

    If `many`, points are added until the effective number of failing candidates is 400.
    """

    def upper(points: Floats) -> Floats:
        means, sigmas = _predict(fits, points)
        return (means + _SIGMAS * sigmas).max(axis=0) + shift

    seed = int(generator.integers(1 << 62))
    plan = SubsetPlan(plan.dimension, 0.0, seed, _CHAINS if many else _CHAINS // 2)
    repetitions = run_subset(upper, plan, range(_REPETITIONS), 1 << 30)
    centers = np.concatenate([repetition.failures for repetition in repetitions])
    probabilities = [repetition.probability for repetition in repetitions if repetition.reached]
    if probabilities:  # Add failure regions that the levels of subset simulation miss.
        chance = min(0.1, float(np.mean(probabilities)))
        centers = np.vstack([centers, find_failures(upper, plan.dimension, 0.0, chance, seed)])
    else:
        centers = np.concatenate([repetition.points for repetition in repetitions])
    mixture = _add_tails(choose_mixture(centers, seed))
    points, candidates = np.empty((0, plan.dimension)), None
    while candidates is None or (
        many and candidates.effective < _FAILING and len(points) < _MOST_CANDIDATES
    ):
        points = np.vstack([points, mixture.draw(max(_CANDIDATES, len(points)), generator)])
        log_normal = -0.5 * (points**2).sum(axis=1) - 0.5 * plan.dimension * np.log(2.0 * np.pi)
        density = np.logaddexp.reduce(mixture.log_parts(points), axis=1)
        weights = np.exp(log_normal - density) / len(points)
        candidates = _Candidates(points, weights, *_predict(fits, points))
    return candidates


def _add_tails(mixture: Mixture) -> Mixture:
    """Return the mixture with additional, wider normals that have the same means."""
    return Mixture(
        np.r_[(1.0 - _TAILS) * mixture.weights, _TAILS * mixture.weights],
        np.r_[mixture.means, mixture.means],
        np.r_[mixture.factors, _WIDER * mixture.factors],
    )


def _judge(candidates: _Candidates, severities: Floats, shift: float) -> Step:
    """Return the estimate after a batch; its interval covers all fits at limits +-`shift`."""
    chances, lows, highs = [], [], []
    for mean, sigma in zip(candidates.means, candidates.sigmas, strict=True):
        chances.append(candidates.chance(mean)[0])
        low, spread = candidates.chance(mean - _SIGMAS * sigma - shift)
        lows.append(low * np.exp(-_SIGMAS * spread))
        high, spread = candidates.chance(mean + _SIGMAS * sigma + shift)
        highs.append(min(1.0, high * np.exp(_SIGMAS * spread)) if high else 1.0)
    failures = int((severities > 0.0).sum())
    return Step(len(severities), failures, tuple(chances), float(min(lows)), float(max(highs)))


def _choose(
    fits: list[GaussianProcess], candidates: _Candidates, generator: np.random.Generator
) -> Floats:
    """Return the batch of candidates that most reduces the misclassified weight."""
    missed = ndtr(-np.abs(candidates.means) / candidates.sigmas) * candidates.weights
    fit = int(np.argmax(missed.sum(axis=1)))
    shares = missed[fit] + 1e-12 * missed[fit].max() + 1e-300
    number = min(_JOINT, len(shares))
    picks = generator.choice(len(shares), number, replace=False, p=shares / shares.sum())
    points, mean = candidates.points[picks], candidates.means[fit, picks]
    covariance = fits[fit].covariance(points)
    chosen: list[int] = []
    # Points are drawn in proportion to weight times misclassification probability.
    initial_errors = np.maximum(ndtr(-np.abs(mean) / np.sqrt(np.diag(covariance) + _TINY)), 1e-300)
    for _ in range(BATCH):
        variance = np.maximum(np.diag(covariance), _TINY)
        # remaining variance [point, chosen]
        remaining = variance[:, None] - covariance**2 / (variance + _TINY)
        errors = ndtr(-np.abs(mean)[:, None] / np.sqrt(np.maximum(remaining, _TINY)))
        loss = (errors / initial_errors[:, None]).sum(axis=0)
        loss[chosen] = np.inf
        best = int(np.argmin(loss))
        chosen.append(best)
        column = covariance[:, best]
        covariance = covariance - np.outer(column, column) / (variance[best] + _TINY)
    return points[chosen]
