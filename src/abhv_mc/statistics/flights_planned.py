"""What a campaign can show before it flies: flights needed, and the chance of PASS against the true failure rate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import betainc

from abhv_mc.statistics.estimates import Floats
from abhv_mc.statistics.sequential import SequentialPlan
from abhv_mc.statistics.verdicts import runs_needed

PLANNED_FAILURES = (0, 1, 2, 3)


def flights_for_failures(probability: float, risk: float) -> dict[int, int]:
    """Flights with which so many failures still PASS."""
    return {failures: runs_needed(failures, probability, risk) for failures in PLANNED_FAILURES}


def most_failures(runs: int, probability: float, risk: float) -> int:
    """Failures with which `runs` flights still PASS; -1 where not even none do."""
    low, high = -1, runs
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if runs_needed(middle, probability, risk) <= runs else (low, middle)
    return low


def can_show(runs: int, probability: float, risk: float) -> bool:
    """Whether some outcome of `runs` flights is a PASS."""
    return runs_needed(0, probability, risk) <= runs


def pass_chance(runs: int, probability: float, risk: float, rates: Floats) -> Floats:
    """Chance of PASS after `runs` flights, for each true failure rate [rate]."""
    most = most_failures(runs, probability, risk)
    if most < 0:
        return np.zeros_like(rates)
    if most >= runs:
        return np.ones_like(rates)
    return np.asarray(betainc(runs - most, most + 1.0, 1.0 - rates), dtype=np.float64)


@dataclass(frozen=True)
class SequentialCurve:
    """A plan that stops when proven, against the true failure rate [rate]."""

    passed: Floats  # chance of PASS
    failed: Floats  # chance of FAIL
    flights: Floats  # expected


def sequential_curve(plan: SequentialPlan, rates: Floats) -> SequentialCurve:
    """Exact chances and expected flights of a sequential plan."""
    found = [plan.crossing(1.0 - rate) for rate in rates.tolist()]
    return SequentialCurve(
        np.array([one.passed.sum() for one in found]),
        np.array([one.failed.sum() for one in found]),
        np.array([one.expected(plan.looks) for one in found]),
    )


def together(chances: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Bounds on the chance that all requirements PASS, from those of each [rate] (Frechet 1935).

    Nothing is assumed of how the failures of one requirement go with those of another.
    """
    stacked = np.stack(list(chances))
    return np.maximum(stacked.sum(axis=0) - (len(stacked) - 1), 0.0), stacked.min(axis=0)
