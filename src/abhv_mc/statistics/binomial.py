"""Exact binomial statistics for a sample size that is fixed in advance.

Sources: Hanson & Beard, "Applying Monte Carlo Simulation to Launch Vehicle Design and Requirements
Verification", NASA/TP-2010-216447; Clopper & Pearson 1934; McNemar 1947 in its exact form. All
functions assume independent flights.
"""

from bisect import bisect_left
from collections.abc import Callable
from functools import lru_cache

from scipy.special import betainc, betaincinv


def _check(failures: int, runs: int, **probabilities: float) -> None:
    if not 0 <= failures <= runs:
        raise ValueError(f"failures must be between 0 and {runs}, found {failures}")
    for name, value in probabilities.items():
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} must be between 0 and 1, found {value}")


def consumer_risk(failures: int, runs: int, probability: float) -> float:
    """Return P(at most `failures` failures in `runs` flights) at a success `probability`."""
    _check(failures, runs, probability=probability)
    return 1.0 if failures == runs else float(betainc(runs - failures, failures + 1, probability))


def success_lower_bound(failures: int, runs: int, consumer_risk: float) -> float:
    """Return the one-sided Clopper-Pearson lower bound on the success probability.

    The chance that the bound exceeds the true probability is at most `consumer_risk`.
    """
    _check(failures, runs, consumer_risk=consumer_risk)
    return (
        0.0 if failures == runs else float(betaincinv(runs - failures, failures + 1, consumer_risk))
    )


def first_where(low: int, holds: Callable[[int], bool]) -> int:
    """Return the smallest integer >= `low` for which the monotonic predicate is true."""
    high = max(low, 1)
    while not holds(high):
        low, high = high + 1, 2 * high
    return low + bisect_left(range(low, high), True, key=holds)


@lru_cache(maxsize=4096)
def runs_needed(failures: int, probability: float, consumer_risk: float) -> int:
    """Return the number of flights that demonstrates `probability` if `failures` flights fail."""
    _check(failures, failures, probability=probability, consumer_risk=consumer_risk)
    return first_where(
        failures + 1,
        lambda runs: betainc(runs - failures, failures + 1, probability) <= consumer_risk,
    )


@lru_cache(maxsize=4096)
def quantile_upper_rank(runs: int, probability: float, confidence: float) -> int | None:
    """Return the rank of the value that bounds the `probability` quantile from above.

    The rank counts from 1 in ascending order. Return None if even the largest of `runs` values is
    not a bound at this `confidence`.
    """
    _check(0, runs, probability=probability, confidence=confidence)
    if runs == 0 or 1.0 - probability**runs < confidence:
        return None
    # Find the rank from the exact binomial tail.
    return first_where(
        1,
        lambda rank: (
            rank >= runs or betainc(runs - rank + 1, rank, 1.0 - probability) >= confidence
        ),
    )


def mcnemar_exact(b: int, c: int) -> float:
    """Return the two-sided exact p-value of McNemar's test.

    `b` and `c` count the pairs in which only one of the two controllers failed.
    """
    if b < 0 or c < 0:
        raise ValueError(f"counts cannot be negative, found {b} and {c}")
    least, pairs = min(b, c), b + c
    return (
        1.0 if 2 * least >= pairs else min(1.0, 2.0 * float(betainc(pairs - least, least + 1, 0.5)))
    )


def mcnemar_one_sided(only_a: int, only_b: int) -> float:
    """Return McNemar's exact p-value of the hypothesis that `b` fails no more often than `a`."""
    return float(betainc(only_b, only_a + 1, 0.5)) if only_b else 1.0


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the exact two-sided Clopper-Pearson interval of the failure probability."""
    _check(failures, runs, confidence=confidence)
    tail = (1.0 - confidence) / 2.0
    if runs == 0:
        return 0.0, 1.0
    low = 0.0 if failures == 0 else float(betaincinv(failures, runs - failures + 1, tail))
    high = 1.0 if failures == runs else float(betaincinv(failures + 1, runs - failures, 1.0 - tail))
    return low, high


def jeffreys(failures: int, runs: int) -> tuple[float, float]:
    """Return the equal-tailed Jeffreys interval of the failure probability.

    Its coverage is close to 95 % on average over the failure probabilities, not for each
    failure probability (Brown, Cai & DasGupta 2001).
    """
    _check(failures, runs)
    tail, a, b = (1.0 - 0.95) / 2.0, failures + 0.5, runs - failures + 0.5
    low = 0.0 if failures == 0 else float(betaincinv(a, b, tail))
    high = 1.0 if failures == runs else float(betaincinv(a, b, 1.0 - tail))
    return low, high
