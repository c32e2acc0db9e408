"""All verdicts of a campaign together: the manifest and the report judge with this, so that they cannot disagree.

How likely any of them is a false PASS, and how to keep that within one risk, is Holm's procedure (1979). It does not
need the verdicts to be independent, and those on the same flights are not.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from abhv_mc.statistics.unknowns import judge_points
from abhv_mc.statistics.verdicts import Verdict


def judge_family(
    groups: Sequence[Sequence[Verdict]], independent: bool = True, family_risk: float | None = None
) -> list[tuple[Verdict, int]]:
    """Of verdicts at each value of unknowns the one over these, and which has its counts; all one family with a risk.

    Flights that are not `independent` draws (stratified designs, sequences) get an ESTIMATE.
    """
    if not independent:
        groups = [
            [replace(each, status="ESTIMATE", E_pass=0.0, E_fail=0.0) for each in group]
            for group in groups
        ]
    found = [judge_points(group) for group in groups]
    verdicts = [verdict for verdict, _ in found]
    if independent and family_risk is not None:
        verdicts = hold_family(verdicts, family_risk)
    return list(zip(verdicts, [worst for _, worst in found], strict=True))


def holm(p_values: Sequence[float], risk: float) -> list[bool]:
    """Which hypotheses are rejected so that any false rejection has a chance of at most `risk`, in their order."""
    rejected = [False] * len(p_values)
    for rank, k in enumerate(np.argsort(p_values, kind="stable").tolist()):
        if p_values[k] > risk / (len(p_values) - rank):
            break
        rejected[k] = True
    return rejected


def hold_family(verdicts: Sequence[Verdict], risk: float) -> list[Verdict]:
    """Verdicts with the chance of any false PASS at most `risk`: a PASS that Holm drops is NOT SHOWN.

    FAIL stands: nothing is accepted by it. What is not shown is to be shown at Bonferroni's share of the risk, with
    which Holm keeps a PASS whatever the others are.
    """
    kept = holm([verdict.p_value for verdict in verdicts], risk)
    held = []
    note = f"PASS alone, but not with a chance of at most {100.0 * risk:g} % of any false PASS"
    note += f" among {len(verdicts)} verdicts"
    for verdict, stands in zip(verdicts, kept, strict=True):
        share = min(verdict.consumer_risk, risk / len(verdicts))
        if verdict.status == "PASS" and not stands:
            held.append(replace(verdict, status="NOT SHOWN", note=note, consumer_risk=share))
        else:
            held.append(
                replace(verdict, consumer_risk=share) if verdict.status == "NOT SHOWN" else verdict
            )
    return held
