"""Rules for where failures live: half-lines, both ends, corners and differences, and where exactly they begin."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats

_NEAR = 0.05  # of the flights, within which a threshold is moved off its quantile


@dataclass(frozen=True)
class Condition:
    """`input` above (or below) `threshold`; or that input less another, each in its standard deviations."""

    input: int  # column of the inputs
    above: bool
    threshold: float
    minus: int | None = None  # the other input


@dataclass(frozen=True)
class Rule:
    """A region that failures prefer."""

    conditions: tuple[Condition, ...]
    failures_inside: int
    failures: int
    others_inside: int
    others: int
    p_value: float  # adjusted for the candidates of this input or pair
    q_value: float  # false-discovery rate at which it is still found
    either: bool = False  # whether one of the conditions is enough


def sharpen(rule: Rule, failed: NDArray[np.bool_], column: Callable[[int], Floats]) -> Rule:
    """The rule of a half-line or of both ends with each threshold moved, between quantiles, to where failures begin.

    The p-value stays that of the quantiles, which were chosen without looking so close.
    """
    if len(rule.conditions) > 1 and not rule.either:
        return rule
    conditions, inside = [], np.zeros(failed.size, dtype=np.bool_)
    for condition in rule.conditions:
        values = _values(condition, column)
        order = np.argsort(-values if condition.above else values, kind="stable")  # the most extreme first
        reached = int(np.sum(_meets(condition, values)))
        near = max(2, round(_NEAR * failed.size))
        tried = np.arange(max(1, reached - near), min(failed.size - 1, reached + near) + 1)
        tried = tried[values[order[tried - 1]] != values[order[tried]]]  # equal values are on one side
        if not tried.size:
            return rule
        bad = np.cumsum(failed[order])[tried - 1]
        worth = bad / rule.failures - (tried - bad) / rule.others
        count = int(tried[np.argmax(worth)])
        inside_end, outside_end = float(values[order[count - 1]]), float(values[order[count]])
        threshold = (inside_end + outside_end) / 2.0
        if not np.isfinite(threshold):  # times of failures that never come are infinite
            threshold = outside_end if condition.above else inside_end
        conditions.append(replace(condition, threshold=threshold))
        inside |= _meets(conditions[-1], values)
    hits, size = int(np.sum(inside & failed)), int(inside.sum())
    return replace(rule, conditions=tuple(conditions), failures_inside=hits, others_inside=size - hits)


def _values(condition: Condition, column: Callable[[int], Floats]) -> Floats:
    if condition.minus is None:
        return column(condition.input)
    return standardise(column(condition.input)) - standardise(column(condition.minus))


def standardise(values: Floats) -> Floats:
    """Values [flight] less their mean, in their standard deviations; they must vary."""
    return (values - np.mean(values)) / np.std(values)


def _meets(condition: Condition, values: Floats) -> NDArray[np.bool_]:
    return values > condition.threshold if condition.above else values <= condition.threshold
