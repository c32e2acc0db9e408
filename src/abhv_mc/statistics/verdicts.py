"""Whether a requirement is met: one rule, a function of the counts alone, whenever and however often one looks."""

from dataclasses import dataclass
from math import exp, inf, log
from typing import Literal

import numpy as np
from scipy.special import betainc

from abhv_mc.array_types import Floats
from abhv_mc.statistics.evidence import (
    flights_to_pass,
    log_fail_evidence,
    log_pass_evidence,
    most_failures,
)

Status = Literal["PASS", "FAIL", "NOT SHOWN", "ESTIMATE"]

UNSEARCHED = "its worst values of the unknowns were not searched for: a new folder does that"
_WORTH_TRYING = 0.25  # chance of PASS at today's rate with which an extension is advised
_MOST_ADVISED = 10_000_000  # flights


@dataclass(frozen=True)
class Verdict:
    """What `failures` in `flights` say about one requirement on one controller."""

    status: Status
    failures: int  # of all kinds, flights that were not computed among them
    flights: int
    probability: float  # the required success probability
    consumer_risk: float  # of a PASS of a system that just misses the requirement
    producer_risk: float  # of a FAIL of a system that just meets it
    E_pass: float  # evidence that it is met: PASS from 1 / consumer_risk on
    E_fail: float  # evidence that it is missed: FAIL from 1 / producer_risk on; 0 with fewer than two failures
    uncomputed: int = (
        0  # flights that the machine could not compute: failures for a PASS, successes for a FAIL
    )
    note: str = ""  # why the status is what it is, where the counts do not say it

    @property
    def p_value(self) -> float:
        """Of the hypothesis that the requirement is missed, valid at any number of flights."""
        return min(1.0, 1.0 / self.E_pass) if self.E_pass > 0.0 else 1.0


def judge(
    failures: int,
    flights: int,
    probability: float,
    consumer_risk: float = 0.1,
    producer_risk: float | None = None,
    uncomputed: int = 0,
) -> Verdict:
    """PASS, FAIL or NOT SHOWN after `failures` in `flights` independent flights.

    A system that just misses the required success `probability` ever gets a PASS with a chance of at most
    `consumer_risk`, and one that just meets it a FAIL with at most `producer_risk` (default: the consumer's).
    `uncomputed` of the flights are not among the failures: a PASS has to hold counting them as failures, a FAIL as
    successes. Raises ValueError for counts and probabilities that cannot be.
    """
    producer_risk = consumer_risk if producer_risk is None else producer_risk
    if uncomputed < 0 or failures < 0 or failures + uncomputed > flights:
        raise ValueError(
            f"failures must lie in 0..{flights}, found {failures} and {uncomputed} not computed"
        )
    risks = {
        "probability": probability,
        "consumer_risk": consumer_risk,
        "producer_risk": producer_risk,
    }
    for name, value in risks.items():
        if not 0.0 < value < 1.0:
            raise ValueError(f"{name} must lie between 0 and 1, found {value}")
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
        status,
        counted,
        flights,
        probability,
        consumer_risk,
        producer_risk,
        _exp(met),
        _exp(missed),
        uncomputed,
    )


def _exp(logarithm: float) -> float:
    return inf if logarithm > 700.0 else exp(logarithm)


@dataclass(frozen=True)
class Extension:
    """A number of flights with which a campaign may PASS."""

    flights: int  # in all
    failures: int  # most of the added flights that may fail
    chance: float  # at the failure rate seen so far


def advise(verdict: Verdict) -> Extension | None:
    """The shortest extension that passes with a fair chance at today's failure rate, or else if no added flight fails.

    None where the failure rate exceeds what is allowed, so that more flights would rather show that.
    """
    rate = verdict.failures / verdict.flights if verdict.flights else 0.0
    if verdict.status == "PASS" or rate >= 1.0 - verdict.probability:
        return None
    first = None
    more = 0
    while True:
        flights = flights_to_pass(
            verdict.failures + more, verdict.probability, verdict.consumer_risk
        )
        added = flights - verdict.flights
        if added > 0:
            chance = (
                1.0
                if rate == 0.0
                else float(betainc(added - more, more + 1, 1.0 - rate))
                if added > more
                else 1.0
            )
            found = Extension(flights, more, chance)
            first = first or found
            if chance >= _WORTH_TRYING:
                return found
        if flights > _MOST_ADVISED:
            return first
        more += max(1, more // 4)


def tolerance_limit(
    worse: Floats, uncomputed: int, probability: float, consumer_risk: float
) -> float | None:
    """The severity [flight], larger being worse, that a share `probability` of all flights stays below: the (k + 1)-th
    worst, k being the most failures with which so many flights PASS. None where not even none do.

    Right with a confidence of 1 - `consumer_risk` at any number of flights; a requirement has a PASS where it lies
    below the limit. A lost flight is +infinity, as are those that were not computed.
    """
    rank = most_failures(worse.size + uncomputed, probability, consumer_risk) - uncomputed
    if rank + uncomputed < 0:
        return None
    return inf if rank < 0 else float(-np.partition(-worse, rank)[rank])


def verdict_words(verdict: Verdict, flies: bool = True) -> str:
    """'NOT SHOWN: 1 failure in 1000 flights; extend to 2235 flights ...', all that a reader needs to weigh it."""
    words = f"{verdict.status}: {_count(verdict.failures, 'failure')} in {_count(verdict.flights, 'flight')}"
    if verdict.uncomputed:
        words += f", {verdict.uncomputed} of them not computed (failures for a PASS, successes for a FAIL)"
    parts = [words, verdict.note]
    if verdict.status == "NOT SHOWN":
        parts.append(advice_words(verdict, flies))
    return "; ".join(part for part in parts if part)


def advice_words(verdict: Verdict, flies: bool = True) -> str:
    """To how many flights a campaign, or a table that flies no more, is to be extended; how likely it passes then."""
    if UNSEARCHED in verdict.note:
        return ""
    found = advise(verdict)
    if found is None:
        return "more of its flights failed than the requirement allows"
    most = (
        f"at most {found.failures} of them fail"
        if found.failures > 1
        else f"at most {found.failures} of them fails"
    )
    condition = (
        "none of the added flights fails"
        if not found.failures
        else most.replace("them", "the added flights")
    )
    chance = f", {100.0 * found.chance:.2g} % at today's rate" if verdict.failures else ""
    more = f"extend to {found.flights} flights (--runs {found.flights})"
    return f"{more if flies else f'adopt a table of {found.flights} flights'}: passes if {condition}{chance}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
