"""Which flights are the worst, in one order for every use: arrays only.

Flights that ended early come first, the earliest before all others. The rest is shared in turn over what is asked, each
in the order of how far a flight is beyond its limit, so that no requirement crowds out the others.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.numerics.bounds import Bounds
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


def spread(values: Floats) -> float:
    """95 minus 5 % quantile of the finite values; 1 where there is none."""
    finite = values[np.isfinite(values)]
    low, high = np.percentile(finite, _SPREAD) if finite.size else (0.0, 0.0)
    return float(high - low) or 1.0


def order_of(excess: Floats, flights: NDArray[np.int64]) -> list[int]:
    """Flight numbers [flight], the largest excess first; of equals the lower number."""
    return flights[np.lexsort((flights, -excess))].tolist()


def choose_worst(early: Iterable[tuple[float, int]], orders: Sequence[Sequence[int]], number: int) -> list[int]:
    """The ``number`` worst flights: those that ended ``early`` (time, flight), then one of each order in turn."""
    chosen = [flight for _, flight in sorted(early)][:number]
    seen = set(chosen)
    places = [0] * len(orders)
    while len(chosen) < number:
        before = len(chosen)
        for i, order in enumerate(orders):
            while places[i] < len(order) and order[places[i]] in seen:
                places[i] += 1
            if places[i] < len(order) and len(chosen) < number:
                chosen.append(order[places[i]])
                seen.add(order[places[i]])
        if len(chosen) == before:
            break
    return chosen
