"""The limits of a requirement: who fails it and by how much, said once for counting, ranking, reports and searches."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Mask


class Bounds(NamedTuple):
    """A value has to lie above ``low`` and below ``high``, in the same unit; None where that side is free, not both."""

    low: float | None = None
    high: float | None = None

    def as_entry(self) -> dict[str, float]:
        """The keys of an entry of a campaign or a matrix."""
        return {
            key: value
            for key, value in zip(("above", "below"), self, strict=True)
            if value is not None
        }

    def __str__(self) -> str:
        """'below 50', 'above 3', 'between 3 and 50'."""
        if self.low is not None and self.high is not None:
            return f"between {self.low:g} and {self.high:g}"
        return " ".join(f"{side} {value:g}" for side, value in self.as_entry().items())

    @property
    def symbols(self) -> str:
        """'< 50', '> 3', 'between 3 and 50'."""
        return str(self).replace("below", "<").replace("above", ">")

    @property
    def both(self) -> bool:
        """Whether there are two limits."""
        return self.low is not None and self.high is not None

    @property
    def sign(self) -> float:
        """-1 where small values are bad; what is bad of two limits is a large distance outside them."""
        return -1.0 if self.high is None else 1.0

    def worse(self, values: Floats) -> Floats:
        """Values turned so that larger is worse: signed ones, or the distance outside two limits, negative inside."""
        if self.low is not None and self.high is not None:
            return np.maximum(self.low - values, values - self.high)
        return self.sign * values

    @property
    def limit(self) -> float:
        """What these have to be below: a signed limit, 0 of two."""
        return 0.0 if self.both else self.sign * sum(self.as_entry().values())

    @property
    def size(self) -> float:
        """What a distance is a share of: the limit's size, or half of what is between two; 0 for a limit of zero."""
        return (
            (self.high - self.low) / 2.0
            if self.low is not None and self.high is not None
            else abs(self.limit)
        )

    def failures(self, values: Floats, early: Mask | None = None) -> Mask:
        """Which flights [flight] fail: by their metric, where not-a-number fails, and those that ended ``early``."""
        failed = ~(self.worse(values) < self.limit)
        return failed if early is None else failed | early
