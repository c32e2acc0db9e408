"""Which flights are the worst, in one order for every use: arrays only."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.bounds import Bounds
from abhv_mc.statistics.estimates import Sense, severity

_SPREAD = (5.0, 95.0)  # percentiles of all flights


class Criterion(NamedTuple):
    """By what flights are ranked: a metric's distance beyond a limit, on the side that is bad."""

    metric: str
    bad: Sense
    limits: Bounds | None = None  # of its requirement

    def excess(self, values: Floats) -> Floats:
        """Signed distance [flight] beyond the limits (without any: the value itself, turned so that larger is worse),
        in the metric's unit; not-a-number is beyond every one."""
        if self.limits is None:
            return severity(values, self.bad)
        return severity(self.limits.worse(values) - self.limits.limit, "high")

    def scale(self, values: Floats) -> tuple[float, float]:
        """From where an excess is measured, and in what: from the limits in their size, which is the 5 to 95 % span of
        these ``values`` [flight] where the limit is 0; without limits from their median in its size."""
        excess = self.excess(values)
        finite = excess[np.isfinite(excess)]
        start = 0.0 if self.limits or not finite.size else float(np.median(finite))
        return start, (self.limits.size if self.limits else abs(start)) or spread(values)


def spread(values: Floats) -> float:
    """95 minus 5 % quantile of the finite values; 1 where there is none."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, _SPREAD) if finite.size else (0.0, 0.0)
    return float(high - low) or 1.0


def worst_first(lost_at: Floats, beyond: Floats) -> NDArray[np.intp]:
    """The flights, the worst first: those that were lost by the time of their end (``lost_at`` [flight], infinite for
    the others), then by their distance ``beyond`` a limit, the largest first; of equals the first."""
    return np.lexsort((-beyond, lost_at))
