"""Bootstrap intervals that keep pairs together: one set of resamples serves every metric and every controller."""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.estimates import Floats, Interval, sorted_quantile

SEED = 20140  # fixed: the same flights give the same interval
_CELLS = 4_000_000  # counts held at a time in cumulative form


def replicates_for(flights: int) -> int:
    """How many resamples are worth their time: 1000 for small campaigns, never under 200."""
    return int(np.clip(2_000_000 // max(flights, 1), 200, 1000))


class PairedBootstrap:
    """Resamples of whole flights, so that what is compared flew the same dispersions in each resample."""

    def __init__(self, flights: int, replicates: int | None = None, seed: int = SEED) -> None:
        if flights < 1:
            raise ValueError("a bootstrap needs at least one flight")
        self.flights = flights
        self.replicates = replicates_for(flights) if replicates is None else replicates
        draw = np.random.default_rng(seed)
        self.counts = np.empty((self.replicates, flights), dtype=np.uint8)  # [replicate, flight] times drawn
        for row in self.counts:
            # More than 255 draws of one flight have a probability below 1e-300.
            row[:] = np.bincount(draw.integers(0, flights, flights), minlength=flights)

    def quantiles(self, values: Floats, probabilities: tuple[float, ...]) -> Floats:
        """numpy's `linear` quantiles of every resample of `values` [flight] -> [replicate, probability]."""
        order = np.argsort(values, kind="stable")
        ascending = values[order]
        result = np.empty((self.replicates, len(probabilities)))
        rows = max(1, _CELLS // self.flights)
        for start in range(0, self.replicates, rows):
            reached = np.cumsum(self.counts[start : start + rows, order], axis=1, dtype=np.int32)
            for column, probability in enumerate(probabilities):
                position = (self.flights - 1) * probability
                below = int(position)
                low = ascending[_first_above(reached, below)]
                high = ascending[_first_above(reached, min(below + 1, self.flights - 1))]
                with np.errstate(invalid="ignore"):
                    between = low + (position - below) * (high - low)
                result[start : start + rows, column] = np.where((low == high) | (position == below), low, between)
        return result

    def means(self, values: Floats) -> Floats:
        """Mean of every resample of `values` [flight] -> [replicate]."""
        return self.counts @ values / self.flights


def _first_above(cumulative: NDArray[np.int32], rank: int) -> NDArray[np.intp]:
    """First column of each row whose cumulative count exceeds `rank`."""
    return np.argmax(cumulative > rank, axis=1)


def interval_of(estimate: float, replicates: Floats, confidence: float = 0.95) -> Interval:
    """Percentile interval of the replicates around an estimate."""
    ascending = np.sort(replicates)
    tail = (1.0 - confidence) / 2.0
    return Interval(estimate, sorted_quantile(ascending, tail), sorted_quantile(ascending, 1.0 - tail))


def quantile_differences(
    a: Floats, b: Floats, probabilities: tuple[float, ...], bootstrap: PairedBootstrap, confidence: float = 0.95
) -> list[Interval]:
    """Quantiles of `a` minus those of `b`, each with the bootstrap interval over pairs; NaN where both are infinite."""
    spread_a, spread_b = bootstrap.quantiles(a, probabilities), bootstrap.quantiles(b, probabilities)
    sorted_a, sorted_b = np.sort(a), np.sort(b)
    intervals = []
    for column, probability in enumerate(probabilities):
        high_a, high_b = sorted_quantile(sorted_a, probability), sorted_quantile(sorted_b, probability)
        if np.isinf(high_a) and np.isinf(high_b):
            intervals.append(Interval(np.nan, np.nan, np.nan))
            continue
        with np.errstate(invalid="ignore"):
            replicates = spread_a[:, column] - spread_b[:, column]
        replicates = np.nan_to_num(replicates, nan=0.0, posinf=np.inf, neginf=-np.inf)  # both infinite: a tie
        intervals.append(interval_of(high_a - high_b, replicates, confidence))
    return intervals
