"""Marginal distributions in SI: what a design's probabilities are turned into values by."""

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Corners, grid and trial flights take an unbounded distribution between these probabilities: +-3 sigma of a normal.
TAIL_PROBABILITY = 0.0013498980316301


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


@dataclass(frozen=True)
class ContinuousMarginal:
    """A frozen continuous distribution of scipy.stats."""

    frozen: Any = field(repr=False)

    def ppf(self, probability: Floats) -> Floats:
        return np.asarray(self.frozen.ppf(probability), np.float64)

    def cdf(self, value: Floats) -> Floats:
        return np.asarray(self.frozen.cdf(value), np.float64)

    def density(self, value: Floats) -> Floats:
        return np.asarray(self.frozen.pdf(value), np.float64)

    def at_fraction(self, fraction: Floats) -> Floats:
        low, high = self.frozen.support()
        if not np.isfinite(low):
            low = self.frozen.ppf(TAIL_PROBABILITY)
        if not np.isfinite(high):
            high = self.frozen.ppf(1.0 - TAIL_PROBABILITY)
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
        return np.where(self.values[place] == value, np.diff(self.cumulative, prepend=0.0)[place], 0.0)

    def at_fraction(self, fraction: Floats) -> Floats:
        return self.values[np.rint(fraction * (len(self.values) - 1)).astype(np.int64)]
