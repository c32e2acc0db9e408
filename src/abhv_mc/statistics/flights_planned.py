"""What a campaign can show before it flies: flights needed, and the chance of PASS against the true failure rate."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc, gammaln, xlog1py, xlogy

from abhv_mc.array_types import Floats
from abhv_mc.statistics.evidence import flights_to_fail, flights_to_pass, most_failures

PLANNED_FAILURES = (0, 1, 2, 3)
_NEGLIGIBLE = 1e-15  # probability of a count of failures that is followed no further
_MOST_LOOKS = 400  # counts of failures at which a long campaign is followed: a bound from below, by less than 1 %


def pass_chance(runs: int, probability: float, risk: float, rates: Floats) -> Floats:
    """Chance that exactly `runs` flights PASS, for each true failure rate [rate]."""
    most = most_failures(runs, probability, risk)
    if most < 0:
        return np.zeros_like(rates)
    if most >= runs:
        return np.ones_like(rates)
    return np.asarray(betainc(runs - most, most + 1.0, 1.0 - rates), dtype=np.float64)


def ever_chance(
    runs: int,
    probability: float,
    risk: float,
    rates: Floats,
    status: Literal["PASS", "FAIL"] = "PASS",
) -> Floats:
    """Chance of the status at some flight up to `runs`, for each true failure rate [rate]: looked at after each."""
    failures, flights = _boundary(runs, probability, risk, status)
    return np.array([_reach(failures, flights, float(rate), status == "PASS") for rate in rates])


def _boundary(
    runs: int, probability: float, risk: float, status: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Counts of failures, and the flights at which they settle: the first for a PASS, the last for a FAIL."""
    passes = status == "PASS"
    if passes:
        failures = np.arange(most_failures(runs, probability, risk) + 1)
    else:
        most, limit = 2, runs
        while flights_to_fail(most, probability, risk) < limit:
            most *= 2
        failures = np.arange(2, most + 1)
    if failures.size > _MOST_LOOKS:
        failures = (
            np.unique(np.round(np.geomspace(1, failures[-1] + 1, _MOST_LOOKS)).astype(np.int64)) - 1
        )
    settle = flights_to_pass if passes else flights_to_fail
    flights = np.array([settle(int(k), probability, risk) for k in failures], dtype=np.int64)
    if passes:
        return failures, flights
    reached = np.minimum(flights, runs)
    fewest = (
        int(np.argmax(flights >= runs)) + 1
    )  # more failures than that settle at no earlier flight
    kept = (flights > 0) & (np.arange(failures.size) < fewest)
    return failures[kept], reached[kept]


@lru_cache(maxsize=512)
def _binomial(flights: int, rate: float) -> tuple[int, Floats]:
    """First count and probabilities of the counts of failures that matter among so many flights."""
    mean, spread = flights * rate, np.sqrt(flights * rate * (1.0 - rate))
    # Beyond ten standard deviations, and thirty counts for the long tails of rare failures, there is nothing left.
    low, high = (
        max(0, int(mean - 10.0 * spread - 30.0)),
        min(flights, int(mean + 10.0 * spread + 30.0)),
    )
    count = np.arange(low, high + 1)
    logarithm = gammaln(flights + 1.0) - gammaln(count + 1.0) - gammaln(flights - count + 1.0)
    return low, np.exp(logarithm + xlogy(count, rate) + xlog1py(flights - count, -rate))


def _reach(
    failures: NDArray[np.int64], flights: NDArray[np.int64], rate: float, low: bool
) -> float:
    """Chance that the failures up to any of `flights` are at most (`low`) or at least `failures` there.

    The counts that have settled nothing are followed from one to the next (Jennison & Turnbull, "Group Sequential
    Methods", 2000, chapter 12).
    """
    reached, first, inside, before = 0.0, 0, np.ones(1), 0
    for count, flight in zip(failures.tolist(), flights.tolist(), strict=True):
        if flight > before:
            start, more = _binomial(flight - before, rate)
            inside, first, before = np.convolve(inside, more), first + start, flight
        cut = int(np.clip(count + 1 - first if low else count - first, 0, inside.size))
        settled, left = (inside[:cut], inside[cut:]) if low else (inside[cut:], inside[:cut])
        reached += float(settled.sum())
        first, inside = (first + cut if low else first), left
        kept = np.flatnonzero(inside > _NEGLIGIBLE)
        if not kept.size:
            break
        first, inside = first + int(kept[0]), inside[kept[0] : kept[-1] + 1]
    return min(reached, 1.0)


def together(chances: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Bounds on the chance that all PASS from those of each [rate], however they go together (Frechet 1935)."""
    stacked = np.stack(list(chances))
    return np.maximum(stacked.sum(axis=0) - (len(stacked) - 1), 0.0), stacked.min(axis=0)
