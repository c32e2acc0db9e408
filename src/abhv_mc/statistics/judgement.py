"""All verdicts of a campaign together: the manifest and the report judge with this, so that they cannot disagree."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.statistics.family import bonferroni, false_pass_bound, hold_family
from abhv_mc.statistics.looks import judge_at_looks, judge_by_plan
from abhv_mc.statistics.sequential import make_sequential_plan
from abhv_mc.statistics.verdicts import Verdict

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Pair:
    """One requirement on one controller, flight by flight in flight order."""

    missed: Flags  # [flight]
    uncomputed: Flags  # [flight] that the machine could not compute
    probability: float
    risk: float
    untried: Flags | None = None  # [flight] not computed, and not flown a second time yet


@dataclass(frozen=True)
class Rules:
    """What the verdicts of a campaign rest on."""

    looks: tuple[int, ...]  # numbers of flights at which all that was planned was there
    plan_looks: tuple[int, ...] = ()  # of a campaign that stops when proven
    independent: bool = True
    family_risk: float | None = None  # of any false PASS among all pairs; None where each has its own risk


def own_risks(risks: Sequence[float], rules: Rules) -> list[float]:
    """The risk that each pair is judged at: its own, or its share of the family's where looks are planned."""
    if rules.plan_looks and rules.family_risk is not None and risks:
        return bonferroni(risks, rules.family_risk)
    return list(risks)


def judge_pairs(pairs: Sequence[Pair], rules: Rules) -> list[Verdict]:
    """The verdict of each pair, in their order."""
    risks = own_risks([pair.risk for pair in pairs], rules)
    if rules.plan_looks:
        return [
            judge_by_plan(
                pair.missed,
                pair.uncomputed,
                make_sequential_plan(rules.plan_looks, pair.probability, risk),
                pair.untried,
            )
            for pair, risk in zip(pairs, risks, strict=True)
        ]
    verdicts = [
        judge_at_looks(pair.missed, pair.uncomputed, rules.looks, pair.probability, risk, rules.independent)
        for pair, risk in zip(pairs, risks, strict=True)
    ]
    return verdicts if rules.family_risk is None else hold_family(verdicts, rules.family_risk)


def count_standing(verdicts: Sequence[Verdict], risk: float) -> int:
    """How many PASSes of a fixed campaign would stand if the chance of any false PASS had to be at most `risk`."""
    return sum(verdict.status == "PASS" for verdict in hold_family(verdicts, risk))


def any_false_pass(risks: Sequence[float], rules: Rules) -> float:
    """Bound on the chance of at least one false PASS among all pairs."""
    bound = false_pass_bound(own_risks(risks, rules))
    return bound if rules.family_risk is None else min(bound, rules.family_risk)
