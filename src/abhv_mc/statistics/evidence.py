"""E-values for k failures in n flights, valid at any number of flights.

Against the allowed failure probability q0 = 1 - `probability` the evidence that a requirement is
met is a mixture of likelihood ratios,

    E_pass = integral over 0 < q < q0 of (q/q0)^k ((1-q)/(1-q0))^(n-k) q^(-3/4) q0^(-1/4) / 4 dq,

and the evidence that it is missed is the same integral over q0 < q < 1 with weights proportional to
q^(-5/4). By Ville's inequality, for a system that just misses (meets) the requirement, the
probability that E_pass (E_fail) ever reaches 1/risk is at most risk, however often the results are
checked (Robbins 1970; Howard, Ramdas, McAuliffe & Sekhon 2021; Ramdas, Gruenwald, Vovk & Shafer
2023).
"""

from functools import lru_cache
from math import log, log1p

from scipy.special import betainc, betaincc, betaln

from abhv_mc.statistics.binomial import first_where

# minimum number of failures for a FAIL, because a single failure does not determine a rate
_FEWEST_TO_FAIL = 2
_ENOUGH = 1e-300  # value of an incomplete beta function below which its logarithm is inaccurate


def log_beta_part(a: float, b: float, x: float, upper: bool = False) -> float:
    """Return log(I / (x^a (1-x)^b)), I = integral of q^(a-1) (1-q)^(b-1) over 0..x or x..1."""
    fraction = float(betaincc(a, b, x) if upper else betainc(a, b, x))
    if fraction > _ENOUGH:
        return log(fraction) + float(betaln(a, b)) - a * log(x) - b * log1p(-x)
    return _log_far(b, a, 1.0 - x) if upper else _log_far(a, b, x)


def _log_far(a: float, b: float, x: float) -> float:
    """Compute `log_beta_part` by a series, for x far below the mean a/(a + b).

    The series is 2F1(1, a + b; a + 1; x) / a (NIST DLMF 8.17.8).
    """
    total, term, k = 1.0, 1.0, 0
    while term > 1e-17 * total:
        k += 1
        term *= (a + b + k - 1.0) * x / (a + k)
        total += term
    return log(total / a)


def log_pass_evidence(failures: int, flights: int, probability: float) -> float:
    """Return log(E_pass); the relative error of E_pass is below 1e-7 up to 1e7 flights."""
    allowed = 1.0 - probability
    a, b = failures + 0.25, flights - failures + 1.0
    return log_beta_part(a, b, allowed) + log1p(-allowed) - log(4.0)


def log_fail_evidence(failures: int, flights: int, probability: float) -> float:
    """Return log(E_fail), which is minus infinity for fewer than two failures."""
    if failures < _FEWEST_TO_FAIL:
        return float("-inf")
    allowed = 1.0 - probability
    a, b = failures - 0.25, flights - failures + 1.0
    weight = 4.0 * (1.0 - allowed**0.25)
    return log_beta_part(a, b, allowed, upper=True) + log1p(-allowed) - log(weight)


@lru_cache(maxsize=65536)
def flights_to_pass(failures: int, probability: float, risk: float) -> int:
    """Return the smallest number of flights for a PASS with `failures` failures."""
    return first_where(
        failures + 1,
        lambda flights: log_pass_evidence(failures, flights, probability) >= -log(risk),
    )


@lru_cache(maxsize=65536)
def flights_to_fail(failures: int, probability: float, risk: float) -> int:
    """Return the largest number of flights for a FAIL with `failures` failures; 0 if none."""

    def holds_out(flights: int) -> bool:
        return log_fail_evidence(failures, flights, probability) < -log(risk)

    if failures < _FEWEST_TO_FAIL or holds_out(failures):
        return 0
    return first_where(failures + 1, holds_out) - 1


@lru_cache(maxsize=65536)
def most_failures(flights: int, probability: float, risk: float) -> int:
    """Return the largest number of failures for a PASS after `flights` flights; -1 if none."""
    return (
        first_where(
            0,
            lambda failures: (
                failures > flights or log_pass_evidence(failures, flights, probability) < -log(risk)
            ),
        )
        - 1
    )
