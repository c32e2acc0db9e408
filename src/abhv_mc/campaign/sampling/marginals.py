"""Marginal distributions in SI: what a design's probabilities are turned into values by."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np

from abhv_mc.array_types import Floats, Mask

# Corners, grid and trial flights take an unbounded distribution between these probabilities: +-3 sigma of a normal.
TAIL_PROBABILITY = 0.0013498980316301
_HALVINGS = 64  # of a mixture's bracket


class Marginal(Protocol):
    """A distribution of a scalar."""

    def ppf(self, probability: Floats) -> Floats:
        """Values at probabilities in (0, 1): the inverse of :meth:`cdf`."""

    def cdf(self, value: Floats) -> Floats:
        """Probability of a value at most ``value``."""

    def density(self, value: Floats) -> Floats:
        """Probability density, or the probability of a discrete value."""

    def at_fraction(self, fraction: Floats) -> Floats:
        """Values at fractions 0..1 of the distribution's extent, for designs that step through values."""


class _Uniform(NamedTuple):
    """As scipy.stats.uniform, to the bit; so :class:`_Normal`: their import takes half a second, these are common."""

    low: float
    width: float

    def ppf(self, probability: Any) -> Any:
        return probability * self.width + self.low

    def cdf(self, value: Floats) -> Floats:
        return np.clip((value - self.low) / self.width, 0.0, 1.0)

    def pdf(self, value: Floats) -> Floats:
        place = (value - self.low) / self.width
        return np.where((place >= 0.0) & (place <= 1.0), 1.0 / self.width, 0.0)

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


_PLAIN: dict[str, Callable[..., Any]] = {"uniform": _Uniform, "norm": _Normal}


@dataclass(frozen=True)
class ContinuousMarginal:
    """A continuous distribution of scipy.stats by its name, with its shape parameters, location and scale."""

    law: str
    arguments: tuple[float, ...]

    @cached_property
    def frozen(self) -> Any:
        """The distribution, of scipy.stats unless it is a plain one."""
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
        if not np.isfinite(high - low):  # 0, where a lognormal one begins, is no value that it has
            low, high = self.frozen.ppf([TAIL_PROBABILITY, 1.0 - TAIL_PROBABILITY])
        return np.asarray(low + (high - low) * fraction, np.float64)


@dataclass(frozen=True)
class DiscreteMarginal:
    """A choice among values, in increasing order, with the probabilities that each or a smaller one is drawn."""

    values: Floats
    cumulative: Floats  # last entry 1

    def ppf(self, probability: Floats) -> Floats:
        return self.values[np.searchsorted(self.cumulative[:-1], probability, side="left")]

    def cdf(self, value: Floats) -> Floats:
        number = np.searchsorted(self.values, value, side="right")
        return np.concatenate(([0.0], self.cumulative))[number]

    def density(self, value: Floats) -> Floats:
        place = np.minimum(np.searchsorted(self.values, value), len(self.values) - 1)
        return np.where(
            self.values[place] == value, np.diff(self.cumulative, prepend=0.0)[place], 0.0
        )

    def at_fraction(self, fraction: Floats) -> Floats:
        return self.values[np.rint(fraction * (len(self.values) - 1)).astype(np.int64)]


@dataclass(frozen=True)
class MixtureMarginal:
    """Each part with its weight; at least one part is continuous."""

    parts: tuple[Marginal, ...]
    weights: tuple[float, ...]  # sum 1

    def ppf(self, probability: Floats) -> Floats:
        """The least values that are reached with the probabilities, by bisection between those of the parts."""
        ends = np.stack([part.ppf(probability) for part in self.parts])
        low, high = ends.min(axis=0), ends.max(axis=0)
        for _ in range(
            _HALVINGS
        ):  # a value's last step changes nothing: none depends on the others of its batch
            middle = low + 0.5 * (high - low)
            if np.all((middle == low) | (middle == high)):
                break
            reached = self.cdf(middle) >= probability
            low, high = np.where(reached, low, middle), np.where(reached, middle, high)
        for atom in find_atoms(self):
            above = self.cdf(np.array([atom]))[0]
            below = above - self.density(np.array([atom]))[0]
            high = np.where((below < probability) & (probability <= above), atom, high)
        return high

    def cdf(self, value: Floats) -> Floats:
        return np.asarray(sum(weight * part.cdf(value) for weight, part in self._weighed()))

    def density(self, value: Floats) -> Floats:
        """Density of the continuous parts; at a discrete part's value its probability."""
        mass, density = np.zeros(np.shape(value)), np.zeros(np.shape(value))
        for weight, part in self._weighed():
            total = mass if isinstance(part, DiscreteMarginal) else density
            total += weight * part.density(value)
        return np.where(mass > 0.0, mass, density)

    def at_fraction(self, fraction: Floats) -> Floats:
        ends = np.array([part.at_fraction(np.array([0.0, 1.0])) for part in self.parts])
        low, high = ends[:, 0].min(), ends[:, 1].max()
        return np.asarray(low + (high - low) * fraction)

    def _weighed(self) -> Iterator[tuple[float, Marginal]]:
        return zip(self.weights, self.parts, strict=True)


@dataclass(frozen=True)
class SometimesMarginal:
    """A drawn value with a probability, else the nominal one: the mixture's quantiles, so that they still rise.

    A flight's one uniform number says both whether the drawn value holds and which. Where the nominal value is
    infinite (a failure that never comes), the flights below ``probability`` are those with the drawn value.
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
        values = self.drawn.ppf(np.clip(share, 2.0**-53, 1.0 - 2.0**-53))
        return np.where((probability >= low) & (probability < high), self.nominal, values)

    def cdf(self, value: Floats) -> Floats:
        return self.probability * self.drawn.cdf(value) + (1.0 - self.probability) * (
            value >= self.nominal
        )

    def density(self, value: Floats) -> Floats:
        """Density of the drawn values, and the probability of the nominal one."""
        with np.errstate(invalid="ignore"):
            drawn = self.probability * self.drawn.density(value)
        return np.where(value == self.nominal, 1.0 - self.probability, drawn)

    def at_fraction(self, fraction: Floats) -> Floats:
        """Values of the drawn distribution's extent: trial flights ask whether a failure matters when it comes."""
        return self.drawn.at_fraction(fraction)


_SLACK = 1e-9  # of a distribution's width: values of a table may be rounded


def outside(marginal: Marginal, values: Floats, rounding: Floats | float = 0.0) -> Mask:
    """Return which values [flight] a distribution never has, ``rounding`` [flight] aside."""
    if isinstance(marginal, SometimesMarginal):
        off_nominal = np.abs(values - marginal.nominal) > rounding
        return outside(marginal.drawn, values, rounding) & off_nominal
    if isinstance(marginal, MixtureMarginal):
        return np.logical_and.reduce([outside(part, values, rounding) for part in marginal.parts])
    if isinstance(marginal, DiscreteMarginal):
        slack = _SLACK * float(np.ptp(marginal.values)) + rounding
        return np.asarray(np.abs(values[:, None] - marginal.values).min(axis=1) > slack)
    scipy_like: Any = marginal
    low, high = scipy_like.frozen.support()
    slack = (_SLACK * (high - low) if np.isfinite(high - low) else 0.0) + rounding
    return np.asarray((values < low - slack) | (values > high + slack))


def find_atoms(marginal: Marginal) -> Floats:
    """Return the values of positive probability."""
    if isinstance(marginal, SometimesMarginal):
        return np.union1d(find_atoms(marginal.drawn), [marginal.nominal])
    if isinstance(marginal, MixtureMarginal):
        return np.unique(np.concatenate([find_atoms(part) for part in marginal.parts]))
    return marginal.values if isinstance(marginal, DiscreteMarginal) else np.empty(0)


def find_moments(marginal: Marginal) -> tuple[float, float]:
    """Return mean and standard deviation."""
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
        parts = [find_moments(part) for part in marginal.parts]
        weights = np.array(marginal.weights)
    elif isinstance(marginal, SometimesMarginal):
        parts = [find_moments(marginal.drawn), (marginal.nominal, 0.0)]
        weights = np.array([marginal.probability, 1.0 - marginal.probability])
    else:
        raise TypeError(f"no moments of {type(marginal).__name__}")
    means, sigmas = np.array(parts).T
    mean = float(weights @ means)
    return mean, float(np.sqrt(weights @ (sigmas**2 + (means - mean) ** 2)))
