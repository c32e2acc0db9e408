"""Joint assessment of all verdicts of a campaign, for the manifest and the report.

Holm's procedure (1979) bounds the chance that any PASS is false. It does not require the verdicts
to be independent; verdicts on the same flights are not independent.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from abhv_mc.io.messages import counted
from abhv_mc.statistics.unknowns import judge_points
from abhv_mc.statistics.verdicts import Verdict


def judge_family(
    groups: Sequence[Sequence[Verdict]], independent: bool = True, family_risk: float | None = None
) -> list[tuple[Verdict, int]]:
    """Return the verdict on each group, with the index of the group's worst point.

    A group contains the verdicts on one requirement at all points of the unknowns. If `family_risk`
    is given, the PASS verdicts are judged jointly. If the flights are not `independent` draws
    (stratified designs, sequences), all verdicts are ESTIMATE.
    """
    if not independent:
        groups = [
            [replace(point, status="ESTIMATE", E_pass=0.0, E_fail=0.0) for point in group]
            for group in groups
        ]
    judged = [judge_points(group) for group in groups]
    verdicts = [verdict for verdict, _ in judged]
    if independent and family_risk is not None:
        verdicts = hold_family(verdicts, family_risk)
    return list(zip(verdicts, [worst for _, worst in judged], strict=True))


def holm(p_values: Sequence[float], risk: float) -> list[bool]:
    """Return True for each hypothesis [p_value] that Holm's procedure rejects.

    The chance of any false rejection is at most `risk`.
    """
    rejected = [False] * len(p_values)
    for rank, k in enumerate(np.argsort(p_values, kind="stable").tolist()):
        if p_values[k] > risk / (len(p_values) - rank):
            break
        rejected[k] = True
    return rejected


def hold_family(verdicts: Sequence[Verdict], risk: float) -> list[Verdict]:
    """Return verdicts among which the chance of any false PASS is at most `risk`.

    A PASS that Holm's procedure does not confirm becomes NOT SHOWN; a FAIL is unchanged, because
    the procedure limits only the chance of a false PASS. The consumer's risk of a verdict NOT SHOWN
    becomes `risk` divided by the number of verdicts (Bonferroni): at this risk, Holm's procedure
    confirms a PASS whatever the other verdicts are.
    """
    rejected = holm([verdict.p_value for verdict in verdicts], risk)
    joint_verdicts = []
    note = f"PASS on its own, but not jointly (chance of any false PASS at most {100.0 * risk:g} %"
    note += f" among {counted(len(verdicts), 'verdict')})"
    for verdict, is_rejected in zip(verdicts, rejected, strict=True):
        judged = verdict
        if verdict.status == "PASS" and not is_rejected:
            judged = replace(verdict, status="NOT SHOWN", note=note)
        if judged.status == "NOT SHOWN":
            judged = replace(judged, consumer_risk=min(verdict.consumer_risk, risk / len(verdicts)))
        joint_verdicts.append(judged)
    return joint_verdicts
