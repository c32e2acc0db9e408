"""Limits of a requirement: failures and excess for counts, ranking, reports and searches."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask


class Bounds(NamedTuple):
    """Limits of a value in its unit, ``low`` < value < ``high``; at most one is None."""

    low: float | None = None
    high: float | None = None

    def as_entry(self) -> dict[str, float]:
        """Return the keys of an entry of a campaign or a requirement matrix."""
        return {
            key: value
            for key, value in zip(("above", "below"), self, strict=True)
            if value is not None
        }

    def __str__(self) -> str:
        """Return 'below 50', 'above 3' or 'between 3 and 50'."""
        if self.low is not None and self.high is not None:
            return f"between {self.low:g} and {self.high:g}"
        return " ".join(f"{side} {value:g}" for side, value in self.as_entry().items())

    @property
    def symbols(self) -> str:
        """Limits as '< 50', '> 3' or 'between 3 and 50'."""
        return str(self).replace("below", "<").replace("above", ">")

    @property
    def both(self) -> bool:
        """True if there are two limits."""
        return self.low is not None and self.high is not None

    @property
    def sign(self) -> float:
        """-1 if small values are bad, else 1."""
        return -1.0 if self.high is None else 1.0

    def worse(self, values: Floats) -> Floats:
        """Return values with larger meaning worse.

        They are signed values, or the distance outside two limits, which is negative inside.
        """
        if self.low is not None and self.high is not None:
            return np.maximum(self.low - values, values - self.high)
        return self.sign * values

    @property
    def limit(self) -> float:
        """Limit of the values of :meth:`worse`: signed, 0 for two limits."""
        return 0.0 if self.both else self.sign * sum(self.as_entry().values())

    @property
    def size(self) -> float:
        """Reference size of a distance: the limit's size, or half the width between two limits."""
        return (
            (self.high - self.low) / 2.0
            if self.low is not None and self.high is not None
            else abs(self.limit)
        )

    def failures(self, values: Floats, early: Mask | None = None) -> Mask:
        """Return the mask of failed flights [flight]: by metric (NaN fails), or ended `early`."""
        failed = ~(self.worse(values) < self.limit)
        return failed if early is None else failed | early
