"""Several verdicts together: how likely any of them is a false PASS, and how to keep that within one risk.

Bonferroni 1936 and Holm 1979; neither needs the verdicts to be independent, and those on the same flights are not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from abhv_mc.statistics.verdicts import Verdict, runs_needed


def false_pass_bound(risks: Sequence[float]) -> float:
    """Bound on the chance of at least one false PASS among verdicts with these risks of their own."""
    return min(1.0, float(sum(risks)))


def holm(p_values: Sequence[float], risk: float) -> list[bool]:
    """Which hypotheses are rejected so that any false rejection has a chance of at most `risk`, in their order."""
    if not 0.0 < risk < 1.0:
        raise ValueError(f"risk must lie between 0 and 1, found {risk}")
    rejected = [False] * len(p_values)
    for rank, k in enumerate(np.argsort(p_values, kind="stable").tolist()):
        if p_values[k] > risk / (len(p_values) - rank):
            break
        rejected[k] = True
    return rejected


def bonferroni(risks: Sequence[float], risk: float) -> list[float]:
    """Risks for the plans of requirements that stop when proven: their own, or an equal share of the family's."""
    return [min(own, risk / len(risks)) for own in risks]


def hold_family(verdicts: Sequence[Verdict], risk: float) -> list[Verdict]:
    """Verdicts of a fixed campaign with the chance of any false PASS at most `risk`: what Holm drops is NOT SHOWN.

    The exact p-value of a PASS is its consumer's risk. No verdict becomes better than it was alone, and estimates
    stay estimates. FAIL stands: nothing is accepted by it. The flights that would show what is not shown are those of
    Bonferroni's share of the risk, with which Holm keeps a PASS whatever the others are.
    """
    judged = [k for k, verdict in enumerate(verdicts) if verdict.consumer_risk is not None]
    kept = dict(zip(judged, holm([float(verdicts[k].consumer_risk or 0.0) for k in judged], risk), strict=True))
    chance = f"a chance of at most {100.0 * risk:g} % of any false PASS"
    note = f"PASS alone, but not with {chance} among {len(judged)} verdicts"
    held = [
        replace(verdict, status="NOT SHOWN", note=note) if verdict.status == "PASS" and not kept[k] else verdict
        for k, verdict in enumerate(verdicts)
    ]
    shares = bonferroni([verdict.risk for verdict in held], risk)
    return [
        replace(verdict, flights_needed=runs_needed(verdict.failures, verdict.probability, share))
        if verdict.status == "NOT SHOWN"
        else verdict
        for verdict, share in zip(held, shares, strict=True)
    ]
