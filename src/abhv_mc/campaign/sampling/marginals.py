"""Marginal distributions in SI units, which convert probabilities to values."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from abhv_mc.array_types import Floats, Mask

# Factorial designs truncate unbounded distributions at this tail probability (+-3 sigma if normal).
TAIL_PROBABILITY = 0.0013498980316301
_HALVINGS = 64  # number of bisection steps for quantiles of a mixture


def clip_probabilities(values: Floats) -> Floats:
    """Clip probabilities to (0, 1), because quantiles at 0 and 1 may be infinite."""
    return np.clip(values, 2.0**-53, 1.0 - 2.0**-53)


class Marginal(Protocol):
    """Interface of a scalar distribution."""

    def ppf(self, probability: Floats) -> Floats:
        """Return the quantiles at probabilities in (0, 1), the inverse of :meth:`cdf`."""

    def cdf(self, value: Floats) -> Floats:
        """Return the probability of values up to and including ``value``."""

    def density(self, value: Floats) -> Floats:
        """Return the probability density, or the probability of a discrete value."""

    def at_fraction(self, fraction: Floats) -> Floats:
        """Return the values at fractions from 0 to 1 of the range, for factorial designs."""


class _Uniform(NamedTuple):
    """Uniform distribution, bit-identical to scipy.stats.uniform.

    Like :class:`_Normal`, this class avoids importing scipy.stats, which takes half a second.
    """

    low: float
    width: float

    def ppf(self, probability: Any) -> Any:
        return probability * self.width + self.low

    def cdf(self, value: Floats) -> Floats:
        return np.clip((value - self.low) / self.width, 0.0, 1.0)

    def pdf(self, value: Floats) -> Floats:
        fraction = (value - self.low) / self.width
        return np.where((fraction >= 0.0) & (fraction <= 1.0), 1.0 / self.width, 0.0)

    def support(self) -> tuple[float, float]:
        return self.low, self.width + self.low


class _Normal(NamedTuple):
    mean: float
    sigma: float

    def ppf(self, probability: Any) -> Any:
        from scipy.special import ndtri

        return ndtri(probability) * self.sigma + self.mean

    def cdf(self, value: Floats) -> Floats:
        from scipy.special import ndtr

        return np.asarray(ndtr((value - self.mean) / self.sigma))

    def pdf(self, value: Floats) -> Floats:
        return (
            np.exp(-(((value - self.mean) / self.sigma) ** 2) / 2.0)
            / np.sqrt(2.0 * np.pi)
            / self.sigma
        )

    def support(self) -> tuple[float, float]:
        return -np.inf, np.inf


_PLAIN = {"uniform": _Uniform, "norm": _Normal}


@dataclass(frozen=True)
class ContinuousMarginal:
    """Continuous distribution of scipy.stats, with a name, shapes, location and scale."""

    law: str
    arguments: tuple[float, ...]

    @cached_property
    def frozen(self) -> Any:
        """Frozen distribution, computed without scipy.stats if it is uniform or normal."""
        if self.law in _PLAIN:
            return _PLAIN[self.law](*self.arguments)
        from scipy import stats

        return getattr(stats, self.law)(*self.arguments)

    def ppf(self, probability: Floats) -> Floats:
        return np.asarray(self.frozen.ppf(probability), np.float64)

    def cdf(self, value: Floats) -> Floats:
        return np.asarray(self.frozen.cdf(value), np.float64)

    def density(self, value: Floats) -> Floats:
        return np.asarray(self.frozen.pdf(value), np.float64)

    def at_fraction(self, fraction: Floats) -> Floats:
        low, high = self.frozen.support()
        if not np.isfinite(
            high - low
        ):  # The lower end 0 of a lognormal distribution is not a possible value.
            low, high = self.frozen.ppf([TAIL_PROBABILITY, 1.0 - TAIL_PROBABILITY])
        return np.asarray(low + (high - low) * fraction, np.float64)


@dataclass(frozen=True)
class DiscreteMarginal:
    """Discrete distribution: ascending values and their cumulative probabilities."""

    values: Floats
    cumulative: Floats  # cumulative probability of each value; the last is 1

    def ppf(self, probability: Floats) -> Floats:
        return self.values[np.searchsorted(self.cumulative[:-1], probability, side="left")]

    def cdf(self, value: Floats) -> Floats:
        number = np.searchsorted(self.values, value, side="right")
        return np.concatenate(([0.0], self.cumulative))[number]

    def density(self, value: Floats) -> Floats:
        index = np.minimum(np.searchsorted(self.values, value), len(self.values) - 1)
        return np.where(
            self.values[index] == value, np.diff(self.cumulative, prepend=0.0)[index], 0.0
        )

    def at_fraction(self, fraction: Floats) -> Floats:
        return self.values[np.rint(fraction * (len(self.values) - 1)).astype(np.int64)]


@dataclass(frozen=True)
class MixtureMarginal:
    """Mixture of weighted components, of which at least one is continuous."""

    parts: tuple[Marginal, ...]
    weights: tuple[float, ...]  # weights with sum 1

    def ppf(self, probability: Floats) -> Floats:
        """Return quantiles by bisection between the quantiles of the components."""
        ends = np.stack([component.ppf(probability) for component in self.parts])
        low, high = ends.min(axis=0), ends.max(axis=0)
        # Further steps do not change converged quantiles, so each quantile depends only on its
        # probability.
        for _ in range(_HALVINGS):
            middle = low + 0.5 * (high - low)
            if np.all((middle == low) | (middle == high)):
                break
            is_reached = self.cdf(middle) >= probability
            low, high = np.where(is_reached, low, middle), np.where(is_reached, middle, high)
        for atom in find_atoms(self):
            above = self.cdf(np.array([atom]))[0]
            below = above - self.density(np.array([atom]))[0]
            high = np.where((below < probability) & (probability <= above), atom, high)
        return high

    def cdf(self, value: Floats) -> Floats:
        return np.asarray(
            sum(weight * component.cdf(value) for weight, component in self._weighed())
        )

    def density(self, value: Floats) -> Floats:
        """Return the density of continuous components, or the probability of a discrete value."""
        mass, density = np.zeros(np.shape(value)), np.zeros(np.shape(value))
        for weight, component in self._weighed():
            total = mass if isinstance(component, DiscreteMarginal) else density
            total += weight * component.density(value)
        return np.where(mass > 0.0, mass, density)

    def at_fraction(self, fraction: Floats) -> Floats:
        ends = np.array([component.at_fraction(np.array([0.0, 1.0])) for component in self.parts])
        low, high = ends[:, 0].min(), ends[:, 1].max()
        return np.asarray(low + (high - low) * fraction)

    def _weighed(self) -> Iterator[tuple[float, Marginal]]:
        return zip(self.weights, self.parts, strict=True)


@dataclass(frozen=True)
class SometimesMarginal:
    """Distribution of a value that is drawn with some probability and nominal otherwise.

    One uniform number determines whether a value is drawn and which value it is, so that quantiles
    increase with probability. If the nominal value is infinite (a failure that never occurs),
    uniform numbers below ``probability`` yield drawn values.
    """

    drawn: Marginal
    probability: float
    nominal: float

    def ppf(self, probability: Floats) -> Floats:
        below = np.array([np.nextafter(self.nominal, -np.inf)])
        low = self.probability * float(self.drawn.cdf(below)[0])
        high = low + 1.0 - self.probability
        share = (
            np.where(probability < low, probability, probability - (1.0 - self.probability))
            / self.probability
        )
        values = self.drawn.ppf(clip_probabilities(share))
        return np.where((probability >= low) & (probability < high), self.nominal, values)

    def cdf(self, value: Floats) -> Floats:
        return self.probability * self.drawn.cdf(value) + (1.0 - self.probability) * (
            value >= self.nominal
        )

    def density(self, value: Floats) -> Floats:
        """Return the density of drawn values, or the probability of the nominal value."""
        with np.errstate(invalid="ignore"):
            drawn = self.probability * self.drawn.density(value)
        return np.where(value == self.nominal, 1.0 - self.probability, drawn)

    def at_fraction(self, fraction: Floats) -> Floats:
        """Return values at fractions of the range of the drawn distribution.

        Factorial designs therefore include a failure regardless of its probability.
        """
        return self.drawn.at_fraction(fraction)


_SLACK = 1e-9  # tolerance for rounded values, relative to the width of the range


def outside(marginal: Marginal, values: Floats, rounding: Floats | float = 0.0) -> Mask:
    """Return a mask [flight] of the values that are impossible for a distribution.

    ``rounding`` [flight] is the rounding error of the values.
    """
    if isinstance(marginal, SometimesMarginal):
        off_nominal = np.abs(values - marginal.nominal) > rounding
        return outside(marginal.drawn, values, rounding) & off_nominal
    if isinstance(marginal, MixtureMarginal):
        return np.logical_and.reduce(
            [outside(component, values, rounding) for component in marginal.parts]
        )
    if isinstance(marginal, DiscreteMarginal):
        slack = _SLACK * float(np.ptp(marginal.values)) + rounding
        return np.asarray(np.abs(values[:, None] - marginal.values).min(axis=1) > slack)
    scipy_like: Any = marginal
    low, high = scipy_like.frozen.support()
    slack = (_SLACK * (high - low) if np.isfinite(high - low) else 0.0) + rounding
    return np.asarray((values < low - slack) | (values > high + slack))


def find_atoms(marginal: Marginal) -> Floats:
    """Return the values that a distribution takes with positive probability."""
    if isinstance(marginal, SometimesMarginal):
        return np.union1d(find_atoms(marginal.drawn), [marginal.nominal])
    if isinstance(marginal, MixtureMarginal):
        return np.unique(np.concatenate([find_atoms(component) for component in marginal.parts]))
    return marginal.values if isinstance(marginal, DiscreteMarginal) else np.empty(0)


def find_moments(marginal: Marginal) -> tuple[float, float]:
    """Return the mean and standard deviation of a distribution."""
    if isinstance(marginal, ContinuousMarginal):
        if marginal.law == "norm":
            return marginal.arguments[0], marginal.arguments[1]
        if marginal.law == "uniform":
            low, width = marginal.arguments
            return low + 0.5 * width, width / 12.0**0.5
        mean, variance = marginal.frozen.stats("mv")
        return float(mean), float(np.sqrt(variance))
    if isinstance(marginal, DiscreteMarginal):
        parts = [(value, 0.0) for value in marginal.values.tolist()]
        weights = np.diff(marginal.cumulative, prepend=0.0)
    elif isinstance(marginal, MixtureMarginal):
        parts = [find_moments(component) for component in marginal.parts]
        weights = np.array(marginal.weights)
    elif isinstance(marginal, SometimesMarginal):
        parts = [find_moments(marginal.drawn), (marginal.nominal, 0.0)]
        weights = np.array([marginal.probability, 1.0 - marginal.probability])
    else:
        raise TypeError(f"no moments of {type(marginal).__name__}")
    means, sigmas = np.array(parts).T
    mean = float(weights @ means)
    return mean, float(np.sqrt(weights @ (sigmas**2 + (means - mean) ** 2)))
