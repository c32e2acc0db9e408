"""Where failures live: half-lines of one input and corners of two that hold more failures than chance allows.

Thresholds are deciles of the samples. A half-line is tested by the exact hypergeometric law. A corner counts only if
each of its two conditions raises the failure rate given the other, so an idle input never rides on a real one. The
best of each input's (pair's) candidates pays for all of them by Bonferroni, and the inputs and pairs together pass
the Benjamini-Hochberg procedure.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import false_discovery_control, hypergeom

from abhv_mc.statistics.estimates import Floats

FALSE_DISCOVERY_RATE = 0.05
FEWEST_FAILURES = 5
_BINS = 10
_MOST_RULES = 20
_CHUNK = 4096


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


@dataclass(frozen=True)
class BinnedInputs:
    """Inputs as far as rules see them."""

    edges: Floats  # [threshold, input], the deciles
    bins: NDArray[np.uint8]  # [flight, input], how many thresholds lie below the value


def bin_inputs(inputs: Iterable[Floats]) -> BinnedInputs:
    """Bin `inputs`, each [flight]; one is held at a time."""
    edges, bins = [], []
    for values in inputs:
        shares = np.arange(1, _BINS) / _BINS
        if np.all(np.isfinite(values)):
            edges.append(np.quantile(values, shares))
        else:  # nothing lies between a number and infinity
            edges.append(np.quantile(values, shares, method="lower"))
        bins.append(np.searchsorted(edges[-1], values, side="left").astype(np.uint8))
    return BinnedInputs(np.stack(edges, axis=1), np.stack(bins, axis=1))


def find_rules(inputs: BinnedInputs, failed: NDArray[np.bool_]) -> list[Rule]:
    """Rules for the `failed` flights [flight], best first; empty where chance explains all."""
    edges, bins = inputs.edges, inputs.bins
    flights, count = bins.shape
    failures = int(failed.sum())
    if failures < FEWEST_FAILURES or flights - failures < FEWEST_FAILURES:
        return []
    candidates = [line for j in range(count) for line in _best_half_lines(j, bins[:, j], failed, edges[:, j])]
    candidates += _best_corners(bins, failed, edges)
    if not candidates:
        return []
    p_values = _p_values(candidates)
    q_values = false_discovery_control(p_values)
    rules = [
        _rule(candidate, flights, failures, float(p_values[k]), float(q_values[k]))
        for k, candidate in enumerate(candidates)
        if q_values[k] <= FALSE_DISCOVERY_RATE
    ]
    # A pair is worth its second condition: ties in p go to the simpler rule.
    rules.sort(key=lambda rule: (rule.p_value, len(rule.conditions)))
    return rules[:_MOST_RULES]


def _rule(candidate: "_Candidate", flights: int, failures: int, p_value: float, q_value: float) -> Rule:
    inside, bad = (int(number) for number in candidate.tables[0][:2])  # the same in each of its tables
    return Rule(candidate.conditions, bad, failures, inside - bad, flights - failures, p_value, q_value)


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


def _best_half_lines(
    column: int, bins: NDArray[np.uint8], failed: NDArray[np.bool_], edges: Floats
) -> list[_Candidate]:
    """The best half-line below and the best above: failures may live at both ends."""
    inside = _sides(np.bincount(bins, minlength=_BINS), 0)
    bad = _sides(np.bincount(bins[failed], minlength=_BINS), 0)
    flights, failures = float(failed.size), float(failed.sum())
    score = _score(inside.astype(float), bad.astype(float), np.array(flights), np.array(failures))
    lines = _BINS - 1
    candidates = []
    for first in (0, lines):
        side = first + int(np.argmax(score[first : first + lines]))
        table = (float(inside[side]), float(bad[side]), flights, failures)
        candidates.append(_Candidate((_condition(column, side, edges),), (table,), lines))
    return candidates


def _joint_counts(bins: NDArray[np.uint8]) -> NDArray[np.int64]:
    """How many flights fall into each pair of bins of each pair of inputs: [input, bin, input, bin]."""
    flights, count = bins.shape
    total = np.zeros((count * _BINS, count * _BINS))
    for start in range(0, flights, _CHUNK):
        part = bins[start : start + _CHUNK]
        marks = np.zeros((part.shape[0], count * _BINS), dtype=np.float32)  # sums to _CHUNK stay exact
        marks[np.arange(part.shape[0])[:, None], np.arange(count) * _BINS + part] = 1.0
        total += marks.T @ marks
    return total.reshape(count, _BINS, count, _BINS).astype(np.int64)


def _best_corners(bins: NDArray[np.uint8], failed: NDArray[np.bool_], edges: Floats) -> list[_Candidate]:
    """The best corner of each pair of inputs (columns of `bins` and `edges`)."""
    first, second = np.triu_indices(bins.shape[1], 1)
    if not first.size:
        return []

    def sides(counts: NDArray[np.int64]) -> tuple[Floats, Floats, Floats]:
        """Inside both conditions [pair, side, side], and inside one [pair, side, 1] and the other [pair, 1, side]."""
        pairs = counts[first, :, second, :]
        alone = _sides(pairs.sum(axis=2), 1)[:, :, None], _sides(pairs.sum(axis=1), 1)[:, None, :]
        return _sides(_sides(pairs, 1), 2).astype(float), alone[0].astype(float), alone[1].astype(float)

    inside, in_first, in_second = sides(_joint_counts(bins))
    bad, bad_first, bad_second = sides(_joint_counts(bins[failed]))
    score = np.minimum(_score(inside, bad, in_first, bad_first), _score(inside, bad, in_second, bad_second))
    best = score.reshape(first.size, -1).argmax(axis=1)
    tried = inside.shape[1] * inside.shape[2]
    candidates = []
    for k, (a, b) in enumerate(np.transpose(np.unravel_index(best, inside.shape[1:])).tolist()):
        n, bad_n = inside[k, a, b], bad[k, a, b]
        tables = (
            (n, bad_n, in_first[k, a, 0], bad_first[k, a, 0]),
            (n, bad_n, in_second[k, 0, b], bad_second[k, 0, b]),
        )
        conditions = (
            _condition(int(first[k]), a, edges[:, first[k]]),
            _condition(int(second[k]), b, edges[:, second[k]]),
        )
        candidates.append(_Candidate(conditions, tables, tried))
    return candidates
