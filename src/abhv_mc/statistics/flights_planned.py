"""Chance of PASS as a function of the true failure rate, before a campaign is run."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.special import betainc, gammaln, xlog1py, xlogy

from abhv_mc.array_types import Floats, Ints
from abhv_mc.statistics.evidence import flights_to_fail, flights_to_pass, most_failures

PLANNED_FAILURES = (0, 1, 2, 3)
_NEGLIGIBLE = 1e-15  # probability below which a count of failures is neglected
# maximum number of boundary points; the chance is a lower bound, up to 6 % low for 6000 flights
_MOST_LOOKS = 400


def pass_chance(runs: int, probability: float, risk: float, rates: Floats) -> Floats:
    """Return the chance of PASS after exactly `runs` flights, for each failure rate [rate]."""
    most = most_failures(runs, probability, risk)
    if most < 0:
        return np.zeros_like(rates)
    if most >= runs:
        return np.ones_like(rates)
    return betainc(runs - most, most + 1.0, 1.0 - rates)


def ever_chance(
    runs: int,
    probability: float,
    risk: float,
    rates: Floats,
    status: Literal["PASS", "FAIL"] = "PASS",
) -> Floats:
    """Return the chance [rate] that the verdict becomes `status` at any flight up to `runs`."""
    failures, flights = _boundary(runs, probability, risk, status)
    return np.array([_reach(failures, flights, float(rate), status == "PASS") for rate in rates])


def _boundary(runs: int, probability: float, risk: float, status: str) -> tuple[Ints, Ints]:
    """Return numbers of failures, each with the number of flights that decides the verdict.

    The verdict is decided at the smallest number of flights for a PASS, or at the largest number of
    flights for a FAIL.
    """
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
    flights = np.array([settle(int(k), probability, risk) for k in failures])
    if passes:
        return failures, flights
    last_flights = np.minimum(flights, runs)
    # Larger numbers of failures cannot decide the verdict at an earlier flight.
    fewest = int(np.argmax(flights >= runs)) + 1
    is_relevant = (flights > 0) & (np.arange(failures.size) < fewest)
    return failures[is_relevant], last_flights[is_relevant]


@lru_cache(maxsize=512)
def _binomial(flights: int, rate: float) -> tuple[int, Floats]:
    """Return the smallest likely failure count, and the probabilities of the likely counts."""
    mean, spread = flights * rate, np.sqrt(flights * rate * (1.0 - rate))
    # Ten standard deviations plus thirty counts include the long tails of rare failures.
    low = max(0, int(mean - 10.0 * spread - 30.0))
    count = np.arange(low, min(flights, int(mean + 10.0 * spread + 30.0)) + 1)
    logarithm = gammaln(flights + 1.0) - gammaln(count + 1.0) - gammaln(flights - count + 1.0)
    return low, np.exp(logarithm + xlogy(count, rate) + xlog1py(flights - count, -rate))


def _reach(failures: Ints, flights: Ints, rate: float, low: bool) -> float:
    """Return the chance that the number of failures crosses the boundary at any of `flights`.

    If `low`, the boundary is crossed by at most `failures` failures, otherwise by at least
    `failures` failures. The distribution of the counts that have not crossed is propagated from one
    boundary point to the next (Jennison & Turnbull, "Group Sequential Methods", 2000, chapter 12).
    """
    chance, first, inside, before = 0.0, 0, np.ones(1), 0
    for count, flight in zip(failures.tolist(), flights.tolist(), strict=True):
        if flight > before:
            start, increment = _binomial(flight - before, rate)
            inside, first, before = np.convolve(inside, increment), first + start, flight
        cut = int(np.clip(count + 1 - first if low else count - first, 0, inside.size))
        settled, left = (inside[:cut], inside[cut:]) if low else (inside[cut:], inside[:cut])
        chance += float(settled.sum())
        first, inside = (first + cut if low else first), left
        relevant = np.flatnonzero(inside > _NEGLIGIBLE)
        if not relevant.size:
            break
        first, inside = first + int(relevant[0]), inside[relevant[0] : relevant[-1] + 1]
    return min(chance, 1.0)


def together(chances: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Return Frechet bounds (1935) on the chance [rate] that all verdicts are PASS."""
    stacked = np.stack(list(chances))
    return np.maximum(stacked.sum(axis=0) - (len(stacked) - 1), 0.0), stacked.min(axis=0)
