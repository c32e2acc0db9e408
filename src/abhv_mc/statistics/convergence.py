"""How an estimate settled as flights came in, in flight order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.statistics.binomial import clopper_pearson
from abhv_mc.statistics.estimates import LEVELS, Interval, quantiles


@dataclass(frozen=True)
class Trace:
    """An estimate after each of `flights` [look] flights; open ends of intervals are infinite."""

    flights: list[int]
    value: list[float]
    low: list[float]
    high: list[float]


def looks(flights: int, number: int = 24, first: int = 20) -> NDArray[np.int64]:
    """Flight counts, evenly spaced by ratio, ending with all of them."""
    if flights <= first:
        return np.array([flights], dtype=np.int64)
    return np.unique(np.round(np.geomspace(first, flights, number)).astype(np.int64))


def _trace(counts: NDArray[np.int64], intervals: list[Interval]) -> Trace:
    return Trace(counts.tolist(), [i.value for i in intervals], [i.low for i in intervals], [i.high for i in intervals])


def quantile_traces(
    values: Floats, counts: NDArray[np.int64], levels: tuple[float, ...] = LEVELS, confidence: float = 0.95
) -> list[Trace]:
    """Quantiles of the first n of `values` [flight] for each n in `counts`, one trace a level."""
    settled = [quantiles(values[:n], levels, confidence) for n in counts]
    return [_trace(counts, list(series)) for series in zip(*settled, strict=True)]


def failure_trace(failed: NDArray[np.bool_], counts: NDArray[np.int64], confidence: float = 0.95) -> Trace:
    """Share of failures among the first n flights for each n in `counts`, with its exact interval."""
    totals = np.cumsum(failed)
    found = []
    for n in counts.tolist():
        failures = int(totals[n - 1])
        found.append(Interval(failures / n, *clopper_pearson(failures, n, confidence)))
    return _trace(counts, found)
