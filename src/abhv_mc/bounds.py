"""Limits of a requirement, with masks of failed flights and distances to the limits."""

from dataclasses import dataclass

import numpy as np

from abhv_mc.array_types import Floats, Mask


@dataclass(frozen=True)
class Bounds:
    """Limits ``low`` < value < ``high`` in the unit of the value; one limit may be None."""

    low: float | None = None
    high: float | None = None

    def as_entry(self) -> dict[str, float]:
        """Return the limits as the entries of a requirement, with the keys above and below."""
        sides = {"above": self.low, "below": self.high}
        return {key: value for key, value in sides.items() if value is not None}

    def __str__(self) -> str:
        """Return the limits as text: 'below 50', 'above 3' or 'between 3 and 50'."""
        if self.low is not None and self.high is not None:
            return f"between {self.low:g} and {self.high:g}"
        return " ".join(f"{side} {value:g}" for side, value in self.as_entry().items())

    @property
    def symbols(self) -> str:
        """Limits as text with symbols: '< 50', '> 3' or 'between 3 and 50'."""
        return str(self).replace("below", "<").replace("above", ">")

    @property
    def both(self) -> bool:
        """Whether there are two limits."""
        return self.low is not None and self.high is not None

    @property
    def sign(self) -> float:
        """Sign of the limit: -1 if small values violate it, else 1."""
        return -1.0 if self.high is None else 1.0

    def worse(self, values: Floats) -> Floats:
        """Return values transformed so that larger means worse.

        For one limit, the result is the values multiplied by the sign of the limit. For two limits,
        it is the distance beyond the nearer limit, which is negative between the limits.
        """
        if self.low is not None and self.high is not None:
            return np.maximum(self.low - values, values - self.high)
        return self.sign * values

    @property
    def limit(self) -> float:
        """Limit for the values returned by :meth:`worse`; 0 if there are two limits."""
        return 0.0 if self.both else self.sign * sum(self.as_entry().values())

    @property
    def size(self) -> float:
        """Scale of distances to a limit: its magnitude, or half the width between two limits."""
        return (
            (self.high - self.low) / 2.0
            if self.low is not None and self.high is not None
            else abs(self.limit)
        )

    def failures(self, values: Floats, early: Mask | None = None) -> Mask:
        """Return the mask [flight] of failed flights.

        A flight fails if its value violates a limit or is NaN, or if it is in the mask `early`.
        """
        failed = ~(self.worse(values) < self.limit)
        return failed if early is None else failed | early
