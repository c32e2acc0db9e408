"""What counted failures prove about a success probability: acceptance sampling with exact binomial probabilities.

Sources: Hanson & Beard, "Applying Monte Carlo Simulation to Launch Vehicle Design and Requirements Verification",
NASA/TP-2010-216447; Clopper & Pearson 1934; McNemar 1947 in its exact form. All of it needs independent flights.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from scipy.special import betainc, betaincinv

Status = Literal["PASS", "FAIL", "NOT SHOWN", "ESTIMATE"]


def _check(failures: int, runs: int, **probabilities: float) -> None:
    if not 0 <= failures <= runs:
        raise ValueError(f"failures must lie in 0..{runs}, found {failures}")
    for name, value in probabilities.items():
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} must lie between 0 and 1, found {value}")


def consumer_risk(failures: int, runs: int, probability: float) -> float:
    """Chance of at most `failures` in `runs` flights when the success probability is only `probability`."""
    _check(failures, runs, probability=probability)
    return 1.0 if failures == runs else float(betainc(runs - failures, failures + 1, probability))


def producer_risk(failures: int, runs: int, probability: float) -> float:
    """Chance of at least `failures` in `runs` flights when the success probability is `probability` after all."""
    _check(failures, runs, probability=probability)
    return 1.0 if failures == 0 else float(betainc(failures, runs - failures + 1, 1.0 - probability))


def success_lower_bound(failures: int, runs: int, consumer_risk: float) -> float:
    """One-sided Clopper-Pearson lower bound on the success probability, wrong with probability `consumer_risk`."""
    _check(failures, runs, consumer_risk=consumer_risk)
    return 0.0 if failures == runs else float(betaincinv(runs - failures, failures + 1, consumer_risk))


def _first(low: int, holds) -> int:  # type: ignore[no-untyped-def]
    """Smallest integer >= low where `holds` is true; `holds` must be monotone."""
    high = max(low, 1)
    while not holds(high):
        low, high = high + 1, 2 * high
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if holds(middle) else (middle + 1, high)
    return low


@lru_cache(maxsize=4096)
def runs_needed(failures: int, probability: float, consumer_risk: float) -> int:
    """Fewest flights with which `failures` failures still prove `probability` at `consumer_risk`."""
    _check(failures, failures, probability=probability, consumer_risk=consumer_risk)
    return _first(
        failures + 1, lambda runs: float(betainc(runs - failures, failures + 1, probability)) <= consumer_risk
    )


@lru_cache(maxsize=4096)
def quantile_upper_rank(runs: int, probability: float, confidence: float) -> int | None:
    """Rank (1-based, ascending) of the flight that bounds the `probability` quantile from above.

    None where even the largest of `runs` values does not reach `confidence`.
    """
    _check(0, runs, probability=probability, confidence=confidence)
    if runs == 0 or 1.0 - probability**runs < confidence:
        return None
    # P(at most rank - 1 values lie below the quantile), exactly.
    return _first(
        1, lambda rank: rank >= runs or float(betainc(runs - rank + 1, rank, 1.0 - probability)) >= confidence
    )


def mcnemar_exact(b: int, c: int) -> float:
    """Two-sided exact p-value of McNemar's test; `b` and `c` count the pairs where only one of the two failed."""
    if b < 0 or c < 0:
        raise ValueError(f"counts cannot be negative, found {b} and {c}")
    least, pairs = min(b, c), b + c
    return 1.0 if 2 * least >= pairs else min(1.0, 2.0 * float(betainc(pairs - least, least + 1, 0.5)))


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided exact interval on the failure probability."""
    _check(failures, runs, confidence=confidence)
    tail = (1.0 - confidence) / 2.0
    if runs == 0:
        return 0.0, 1.0
    low = 0.0 if failures == 0 else float(betaincinv(failures, runs - failures + 1, tail))
    high = 1.0 if failures == runs else float(betaincinv(failures + 1, runs - failures, 1.0 - tail))
    return low, high


def posterior_met(failures: int, runs: int, probability: float) -> float:
    """Probability that the success probability is at least `probability`, from Jeffreys' prior Beta(1/2, 1/2)."""
    _check(failures, runs, probability=probability)
    return float(betainc(failures + 0.5, runs - failures + 0.5, 1.0 - probability))


@dataclass(frozen=True)
class Verdict:
    """What `failures` in `runs` flights say about one requirement on one controller."""

    status: Status
    failures: int  # of all kinds, flights that were not computed among them
    runs: int
    probability: float  # the required success probability
    risk: float  # the consumer's (and producer's) risk that the requirement allows
    lower_bound: float | None  # on the success probability, at `risk`
    consumer_risk: float | None  # chance of so few failures of a system that just misses the requirement
    producer_risk: float | None  # chance of so many failures of a system that just meets it
    flights_needed: int | None  # flights of a new campaign that passes with as many failures; 0 when passed, None: FAIL
    uncomputed: int = 0  # flights that the machine could not compute, counted as failures
    provisional: bool = False  # whether the status would be another one without those
    met: float | None = None  # posterior probability that the requirement is met
    note: str = ""  # why the status is what it is, where the counts do not say it


def judge(
    failures: int, runs: int, probability: float, risk: float = 0.1, independent: bool = True, uncomputed: int = 0
) -> Verdict:
    """PASS when the success probability is proven at the consumer's `risk`, FAIL when its lack is proven at the same.

    Anything between is NOT SHOWN. `uncomputed` of the `runs` flights are not among `failures` and count as such:
    nothing shows that they held. Flights that are not `independent` (stratified or low-discrepancy designs) get an
    ESTIMATE, because the binomial law does not hold for their failures.
    """
    if uncomputed < 0:
        raise ValueError(f"uncomputed flights cannot be negative, found {uncomputed}")
    counted = failures + uncomputed
    _check(counted, runs, probability=probability, risk=risk)
    if not independent:
        return Verdict("ESTIMATE", counted, runs, probability, risk, None, None, None, None, uncomputed)
    status = _status(counted, runs, probability, risk)
    # Without them: had they all held, or had they not been flown.
    others = {_status(failures, runs, probability, risk), _status(failures, runs - uncomputed, probability, risk)}
    return Verdict(
        status,
        counted,
        runs,
        probability,
        risk,
        success_lower_bound(counted, runs, risk),
        consumer_risk(counted, runs, probability),
        producer_risk(counted, runs, probability),
        {"PASS": 0, "FAIL": None}.get(status, runs_needed(counted, probability, risk)),
        uncomputed,
        others != {status},
        posterior_met(counted, runs, probability),
    )


def _status(failures: int, runs: int, probability: float, risk: float) -> Status:
    if consumer_risk(failures, runs, probability) <= risk:
        return "PASS"
    return "FAIL" if producer_risk(failures, runs, probability) <= risk else "NOT SHOWN"
