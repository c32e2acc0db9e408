"""All verdicts of a campaign together: the manifest and the report judge with this, so that they cannot disagree."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from abhv_mc.statistics.family import hold_family
from abhv_mc.statistics.verdicts import Verdict, judge


@dataclass(frozen=True)
class Pair:
    """The counts of one requirement on one controller."""

    failures: int  # without the flights that were not computed
    flights: int
    uncomputed: int
    probability: float
    consumer_risk: float
    producer_risk: float | None = None


def judge_pairs(pairs: Sequence[Pair], independent: bool = True, family_risk: float | None = None) -> list[Verdict]:
    """The verdict of each pair, in their order; all of them one family where it has a risk.

    Flights that are not `independent` draws (stratified designs, sequences) get an ESTIMATE.
    """
    verdicts = [
        judge(p.failures, p.flights, p.probability, p.consumer_risk, p.producer_risk, p.uncomputed) for p in pairs
    ]
    if not independent:
        return [replace(verdict, status="ESTIMATE", E_pass=0.0, E_fail=0.0) for verdict in verdicts]
    return verdicts if family_risk is None else hold_family(verdicts, family_risk)
