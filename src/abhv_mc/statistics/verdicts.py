"""Sequential verdicts on requirements, valid at any number of flights."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, inf, log
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import betaln, gammaln

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import grouped_digits
from abhv_mc.statistics.evidence import (
    flights_to_pass,
    log_fail_evidence,
    log_pass_evidence,
    most_failures,
)

Status = Literal["PASS", "FAIL", "NOT SHOWN", "ESTIMATE"]

SET_LATER = "the requirement was set after results were known"
UNSEARCHED = "the worst values of the unknowns were not searched for; use a new folder"
MOST_TIMES = 10  # largest recommended number of flights, as a multiple of the present number
_LIKELY = 0.5  # minimum chance of PASS after a recommended extension
_TRIED = 40  # number of allowed failure counts for which an extension is examined


@dataclass(frozen=True)
class Verdict:
    """Verdict on one requirement for one controller, with the counts that determine it."""

    status: Status
    failures: int  # number of failures, including flights that were not computed
    flights: int
    probability: float  # required success probability
    consumer_risk: float  # risk of a PASS for a system that just misses the requirement
    producer_risk: float  # risk of a FAIL for a system that just meets the requirement
    E_pass: float  # evidence for a PASS; a PASS needs at least 1 / consumer_risk
    # evidence for a FAIL, 0 for fewer than two failures; a FAIL needs at least 1 / producer_risk
    E_fail: float
    uncomputed: int = 0  # number of flights that failed to run; these count against PASS and FAIL
    note: str = ""  # reason for the status if the counts do not determine it

    @property
    def set_later(self) -> bool:
        """Whether the requirement was set after results were known."""
        return SET_LATER in self.note

    @property
    def label(self) -> str:
        """Status, marked if the requirement was set after results were known."""
        return label_status(self.status, self.set_later)

    @property
    def p_value(self) -> float:
        """P-value, valid at any number of flights, of the hypothesis of a missed requirement."""
        return min(1.0, 1.0 / self.E_pass) if self.E_pass > 0.0 else 1.0


def label_status(status: str, set_later: bool) -> str:
    """Return a status such as 'PASS', or 'PASS (set later)'."""
    return f"{status} (set later)" if set_later else status


def judge(
    failures: int,
    flights: int,
    probability: float,
    consumer_risk: float = 0.1,
    producer_risk: float | None = None,
    uncomputed: int = 0,
) -> Verdict:
    """Return PASS, FAIL or NOT SHOWN for `failures` in `flights` independent flights.

    A system that just misses the required success `probability` has a chance of a PASS of at most
    `consumer_risk`; a system that just meets it has a chance of a FAIL of at most `producer_risk`
    (default: the consumer's risk). Both bounds hold at any number of flights. The `uncomputed`
    flights are not among the failures: a PASS must also be reached if they count as failures, a
    FAIL if they count as successes. Raise ValueError if a count or a probability is out of range.
    """
    producer_risk = consumer_risk if producer_risk is None else producer_risk
    if uncomputed < 0 or failures < 0 or failures + uncomputed > flights:
        raise ValueError(
            f"the sum of failures and flights not computed must be between 0 and {flights}, found "
            f"{failures} and {uncomputed}"
        )
    risks = {
        "probability": probability,
        "consumer_risk": consumer_risk,
        "producer_risk": producer_risk,
    }
    for name, value in risks.items():
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} must be between 0 and 1, found {value}")
    counted = failures + uncomputed
    met = log_pass_evidence(counted, flights, probability)
    missed = log_fail_evidence(failures, flights, probability)
    status: Status = (
        "PASS"
        if met >= -log(consumer_risk)
        else "FAIL"
        if missed >= -log(producer_risk)
        else "NOT SHOWN"
    )
    return Verdict(
        status=status,
        failures=counted,
        flights=flights,
        probability=probability,
        consumer_risk=consumer_risk,
        producer_risk=producer_risk,
        E_pass=_exp(met),
        E_fail=_exp(missed),
        uncomputed=uncomputed,
    )


def _exp(logarithm: float) -> float:
    return inf if logarithm > 700.0 else exp(logarithm)


class Extension(NamedTuple):
    """Number of flights at which all verdicts are likely to be PASS."""

    flights: int  # total number of flights
    chance: float  # chance of PASS for independent failure rates; larger if they are correlated


def predict_pass(verdict: Verdict, flights: int) -> float:
    """Return the chance that the verdict of a campaign extended to `flights` is PASS.

    The number of added failures is beta-binomial: the failure rate is distributed as the posterior
    of Jeffreys' prior.
    """
    added = flights - verdict.flights
    allowed_failures = (
        most_failures(flights, verdict.probability, verdict.consumer_risk) - verdict.failures
    )
    if allowed_failures < 0 or allowed_failures >= added:
        return float(allowed_failures >= 0)
    a, b = verdict.failures + 0.5, verdict.flights - verdict.failures + 0.5
    k = np.arange(allowed_failures + 1.0)
    choose = gammaln(added + 1.0) - gammaln(k + 1.0) - gammaln(added - k + 1.0)
    return min(float(np.sum(np.exp(choose + betaln(a + k, b + added - k) - betaln(a, b)))), 1.0)


def advise(verdicts: Sequence[Verdict]) -> Extension | None:
    """Return the smallest number of flights at which all verdicts are likely to be PASS.

    Return None if even MOST_TIMES the present number of flights is not enough. The chances are
    multiplied as if the failure rates were independent.
    """
    flights = max(verdict.flights for verdict in verdicts)
    rules = {(verdict.probability, verdict.consumer_risk) for verdict in verdicts}
    numbers = set()
    for probability, risk in rules:
        most = most_failures(MOST_TIMES * flights, probability, risk)
        allowed = np.unique(np.geomspace(1, most + 2, _TRIED).astype(np.int64)) - 1
        numbers |= {flights_to_pass(int(k), probability, risk) for k in allowed if k <= most}
    for number in sorted(number for number in numbers if number > flights):
        chance = 1.0
        for verdict in verdicts:
            chance *= predict_pass(verdict, number)
            if chance < _LIKELY:
                break
        else:
            return Extension(number, chance)
    return None


def tolerance_limit(
    worse: Floats, uncomputed: int, probability: float, consumer_risk: float
) -> float | None:
    """Return the severity below which a share `probability` of all flights lies.

    The limit is the (k + 1)-th largest of the severities `worse` [flight], where k is the largest
    number of failures that gives a PASS with these flights. Return None if not even zero failures
    would give a PASS. The limit has a confidence of 1 - `consumer_risk` at any number of flights;
    the verdict is PASS if the limit meets the requirement. Early terminations and `uncomputed`
    flights count as +infinity.
    """
    rank = most_failures(worse.size + uncomputed, probability, consumer_risk) - uncomputed
    if rank + uncomputed < 0:
        return None
    return inf if rank < 0 else float(-np.partition(-worse, rank)[rank])


def verdict_words(verdict: Verdict, flies: bool = True) -> str:
    """Return a verdict as text, such as 'PASS: 1 of 2200 flights failed', with notes and advice."""
    failed, lost = grouped_digits(verdict.failures), grouped_digits(verdict.uncomputed)
    texts = (
        f"{verdict.status}: {failed} of {grouped_digits(verdict.flights)} flights failed",
        f"{lost} of these not computed (failures for a PASS, successes for a FAIL)"
        if verdict.uncomputed
        else "",
        verdict.note,
        advice_words(verdict, flies) if verdict.status == "NOT SHOWN" else "",
    )
    return "; ".join(filter(None, texts))


def advice_words(verdict: Verdict, flies: bool = True) -> str:
    """Return the number of flights that a PASS needs, and its chance with this number, as text."""
    if UNSEARCHED in verdict.note:
        return ""
    number = flights_to_pass(verdict.failures, verdict.probability, verdict.consumer_risk)
    option = ""
    if extension := advise([verdict]):
        number = extension.flights
        option = f" (--runs {number})" if flies else " (a larger table)"
    elif verdict.failures >= (1.0 - verdict.probability) * verdict.flights > 0.0:
        return "more failures than the requirement allows"
    chance = about(predict_pass(verdict, number))
    return f"{grouped_digits(number)} flights needed{option}, chance of PASS {chance}"


def about(chance: float) -> str:
    """Format a predicted chance as 'about 53 %', never as 0 or 100 %."""
    return f"about {min(max(round(100.0 * chance), 1), 99)} %"
