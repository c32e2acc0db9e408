"""Where failures live: half-lines of one input and corners of two that hold more failures than chance allows.

Thresholds are deciles of the samples. A half-line is tested by the exact hypergeometric law. A corner counts only if
each of its two conditions raises the failure rate given the other, so an idle input never rides on a real one. The
best of each input's (pair's) candidates pays for all of them by Bonferroni, and the inputs and pairs together pass
the Benjamini-Hochberg procedure.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import false_discovery_control, hypergeom

from abhv_mc.statistics.estimates import Floats

FALSE_DISCOVERY_RATE = 0.05
FEWEST_FAILURES = 5
_BINS = 10
_MOST_RULES = 20


@dataclass(frozen=True)
class Condition:
    """`input` above (or below) `threshold`."""

    input: int  # column of the inputs
    above: bool
    threshold: float


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


def find_rules(inputs: Floats, failed: NDArray[np.bool_]) -> list[Rule]:
    """Rules for the `failed` flights among `inputs` [flight, input], best first; empty where chance explains all."""
    flights, count = inputs.shape
    failures = int(failed.sum())
    if failures < FEWEST_FAILURES or flights - failures < FEWEST_FAILURES:
        return []
    edges = np.quantile(inputs, np.arange(1, _BINS) / _BINS, axis=0)  # [threshold, input]
    moving = [j for j in range(count) if edges[0, j] < edges[-1, j]]
    bins = np.stack([np.searchsorted(edges[:, j], inputs[:, j], side="left") for j in range(count)], axis=1)
    candidates = [_best_half_line(j, bins[:, j], failed, edges[:, j]) for j in moving]
    candidates += [_best_corner(i, j, bins, failed, edges) for i, j in combinations(moving, 2)]
    if not candidates:
        return []
    p_values = _p_values(candidates)
    q_values = false_discovery_control(p_values)
    rules = [
        _rule(inputs, failed, candidate.conditions, float(p_values[k]), float(q_values[k]))
        for k, candidate in enumerate(candidates)
        if q_values[k] <= FALSE_DISCOVERY_RATE
    ]
    # A pair is worth its second condition: ties in p go to the simpler rule.
    rules.sort(key=lambda rule: (rule.p_value, len(rule.conditions)))
    return rules[:_MOST_RULES]


def _rule(
    inputs: Floats, failed: NDArray[np.bool_], conditions: tuple[Condition, ...], p_value: float, q_value: float
) -> Rule:
    inside = np.ones(failed.size, dtype=np.bool_)
    for c in conditions:
        inside &= inputs[:, c.input] > c.threshold if c.above else inputs[:, c.input] <= c.threshold
    return Rule(
        conditions,
        int(np.sum(inside & failed)),
        int(failed.sum()),
        int(np.sum(inside & ~failed)),
        int(np.sum(~failed)),
        p_value,
        q_value,
    )


def _sides(histogram: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Counts at or below each threshold, then above each, along an axis of bins: 2 (_BINS - 1) half-lines."""
    below = np.cumsum(histogram, axis=axis)
    total = np.take(below, [-1], axis=axis)
    below = np.delete(below, -1, axis=axis)
    return np.concatenate([below, total - below], axis=axis)


def _score(inside: Floats, failed_inside: Floats, flights: Floats, failures: Floats) -> Floats:
    """Standard deviations by which the failures inside exceed what the hypergeometric law expects."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = inside / flights
        variance = failures * share * (1.0 - share) * (flights - failures) / np.maximum(flights - 1.0, 1.0)
        score = (failed_inside - failures * share) / np.sqrt(variance)
    return np.where(variance > 0.0, score, -np.inf)


def _p_values(candidates: list["_Candidate"]) -> Floats:
    """Exact chance of so many failures inside, the larger where there are two tables, times the candidates tried."""
    rows = np.array([table for candidate in candidates for table in candidate.tables], dtype=np.int64)
    inside, bad, flights, failures = rows.T
    tails = hypergeom.sf(bad - 1, flights, failures, inside)
    owners = np.repeat(np.arange(len(candidates)), [len(candidate.tables) for candidate in candidates])
    largest = np.zeros(len(candidates))
    np.maximum.at(largest, owners, tails)
    return np.minimum(largest * np.array([candidate.tried for candidate in candidates]), 1.0)


@dataclass(frozen=True)
class _Candidate:
    """The best region of an input or a pair: flights and failures inside it and in all that it is held against."""

    conditions: tuple[Condition, ...]
    tables: tuple[tuple[float, float, float, float], ...]  # inside, failures inside, flights, failures
    tried: int


def _condition(column: int, side: int, edges: Floats) -> Condition:
    lines = _BINS - 1
    return Condition(column, side >= lines, float(edges[side % lines]))


def _best_half_line(column: int, bins: NDArray[np.intp], failed: NDArray[np.bool_], edges: Floats) -> _Candidate:
    inside = _sides(np.bincount(bins, minlength=_BINS), 0)
    bad = _sides(np.bincount(bins[failed], minlength=_BINS), 0)
    flights, failures = float(failed.size), float(failed.sum())
    side = int(np.argmax(_score(inside.astype(float), bad.astype(float), np.array(flights), np.array(failures))))
    table = (float(inside[side]), float(bad[side]), flights, failures)
    return _Candidate((_condition(column, side, edges),), (table,), inside.size)


def _best_corner(i: int, j: int, bins: NDArray[np.intp], failed: NDArray[np.bool_], edges: Floats) -> _Candidate:
    cell = bins[:, i] * _BINS + bins[:, j]
    shape = (_BINS, _BINS)
    all_cells = np.bincount(cell, minlength=_BINS * _BINS).reshape(shape)
    bad_cells = np.bincount(cell[failed], minlength=_BINS * _BINS).reshape(shape)
    inside = _sides(_sides(all_cells, 0), 1).astype(float)  # [side of i, side of j]
    bad = _sides(_sides(bad_cells, 0), 1).astype(float)
    in_i, bad_i = _sides(all_cells.sum(1), 0).astype(float), _sides(bad_cells.sum(1), 0).astype(float)
    in_j, bad_j = _sides(all_cells.sum(0), 0).astype(float), _sides(bad_cells.sum(0), 0).astype(float)
    given_i = _score(inside, bad, in_i[:, None], bad_i[:, None])
    given_j = _score(inside, bad, in_j[None, :], bad_j[None, :])
    side_i, side_j = np.unravel_index(int(np.argmax(np.minimum(given_i, given_j))), inside.shape)
    n, k = inside[side_i, side_j], bad[side_i, side_j]
    conditions = (_condition(i, int(side_i), edges[:, i]), _condition(j, int(side_j), edges[:, j]))
    tables = ((n, k, in_i[side_i], bad_i[side_i]), (n, k, in_j[side_j], bad_j[side_j]))
    return _Candidate(conditions, tables, inside.size)
