"""Where failures live: half-lines, both ends, corners and differences of inputs that hold more than chance allows.

Thresholds are deciles of the samples and a few quantiles beyond. A half-line is tested by the exact hypergeometric
law. A corner, or both ends of an input, counts only if each of its two conditions raises the failure rate given the
other, so an idle input never rides on a real one; a difference of two inputs only if it says more than each of them
and than their corner. The best of each input's (pair's) candidates pays for all of them by Bonferroni, and the inputs
and pairs together pass the Benjamini-Hochberg procedure.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from abhv_mc.array_types import Floats
from abhv_mc.statistics.ranks import false_discovery

FALSE_DISCOVERY_RATE = 0.05
FEWEST_FAILURES = 5
_QUANTILES = (0.01, 0.02, 0.05, *(n / 10.0 for n in range(1, 10)), 0.95, 0.98, 0.99)
_BINS = len(_QUANTILES) + 1
_DECILES = [
    row for row, quantile in enumerate(_QUANTILES) if 0.1 <= quantile <= 0.9
]  # what corners are cut at
_COARSE = np.searchsorted(_DECILES, np.arange(_BINS)).astype(
    np.uint8
)  # bin between deciles of each bin
_CLEAR = 2.0  # standard deviations below which neither end of an input is looked at closer
_DIFFERED = 6  # inputs, those that failures prefer most, whose differences are tried
_MOST_RULES = 20
_CHUNK = 4096
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


@dataclass(frozen=True)
class BinnedInputs:
    """Inputs as far as rules see them."""

    edges: Floats  # [threshold, input]
    bins: NDArray[np.uint8]  # [flight, input], how many thresholds lie below the value


def bin_inputs(inputs: Iterable[Floats]) -> BinnedInputs:
    """Bin `inputs`, each [flight]; one is held at a time."""
    edges, bins = [], []
    for values in inputs:
        # Nothing lies between a number and infinity.
        method: Literal["linear", "lower"] = "linear" if np.all(np.isfinite(values)) else "lower"
        edges.append(np.quantile(values, _QUANTILES, method=method))
        bins.append(np.searchsorted(edges[-1], values, side="left").astype(np.uint8))
    return BinnedInputs(np.stack(edges, axis=1), np.stack(bins, axis=1))


def find_rules(
    inputs: BinnedInputs, failed: NDArray[np.bool_], column: Callable[[int], Floats]
) -> list[Rule]:
    """Rules for the `failed` flights [flight], best first; `column` gives the values [flight] of an input."""
    edges, bins = inputs.edges, inputs.bins
    flights, count = bins.shape
    failures = int(failed.sum())
    if failures < FEWEST_FAILURES or flights - failures < FEWEST_FAILURES:
        return []
    candidates = []
    for j in range(count):
        candidates += _drop_ends(_along((j,), bins[:, j], failed, edges[:, j]))
    candidates += _best_corners(_COARSE[bins], failed, edges[_DECILES])
    candidates += _differences(candidates, failed, column, count * (count - 1) // 2)
    p_values = _p_values(candidates)
    q_values = false_discovery(p_values)
    rules = [
        _rule(candidate, flights, failures, float(p_values[k]), float(q_values[k]))
        for k, candidate in enumerate(candidates)
        if q_values[k] <= FALSE_DISCOVERY_RATE
    ]
    # A pair is worth its second condition: ties in p go to the simpler rule.
    rules.sort(key=lambda rule: (rule.p_value, len(rule.conditions)))
    return [_sharpen(rule, failed, column) for rule in rules[:_MOST_RULES]]


def _rule(
    candidate: "_Candidate", flights: int, failures: int, p_value: float, q_value: float
) -> Rule:
    inside, bad = map(int, candidate.tables[0][:2])  # the same in each of its tables
    others = flights - failures
    return Rule(
        candidate.conditions,
        bad,
        failures,
        inside - bad,
        others,
        p_value,
        q_value,
        candidate.either,
    )


def _drop_ends(candidates: list["_Candidate"]) -> list["_Candidate"]:
    """Without the half-lines of an input of which both ends say more."""
    if len(candidates) < 3:
        return candidates
    below, above, both = _p_values(candidates)
    return candidates[2:] if both < min(below, above) else candidates[:2]


def _differences(
    candidates: list["_Candidate"],
    failed: NDArray[np.bool_],
    column: Callable[[int], Floats],
    pairs: int,
) -> list["_Candidate"]:
    """Half-lines of differences between the inputs that failures prefer most, where these say more than the two."""
    flights, failures = failed.size, int(failed.sum())
    best: dict[frozenset[int], float] = {}
    # What a corner says as a whole is what its difference has to better, not what each of its conditions adds.
    whole = [
        _Candidate(c.conditions, ((*c.tables[0][:2], flights, failures),), c.tried)
        for c in candidates
    ]
    for candidate, p_value in zip(candidates, _p_values(whole).tolist(), strict=True):
        who = frozenset(condition.input for condition in candidate.conditions)
        best[who] = min(best.get(who, 1.0), p_value)
    alone = sorted((p_value, min(who)) for who, p_value in best.items() if len(who) == 1)
    standard = {}
    for _, j in alone[:_DIFFERED]:
        values = column(j)
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            standard[j] = _standardise(values)
    found = []
    for one, other in combinations(sorted(standard), 2):
        values = standard[one] - standard[other]
        edges = np.quantile(values, _QUANTILES)
        bins = np.searchsorted(edges, values, side="left").astype(np.uint8)
        tried = _drop_ends(_along((one, other), bins, failed, edges, pairs))
        told = min(best.get(frozenset(who), 1.0) for who in ((one,), (other,), (one, other)))
        found += [
            c for c, p_value in zip(tried, _p_values(tried).tolist(), strict=True) if p_value < told
        ]
    return found


def _sides(histogram: NDArray[np.int64], axis: int) -> NDArray[np.int64]:
    """Counts at or below each threshold, then above each, along an axis of bins: 2 (_BINS - 1) half-lines."""
    below = np.cumsum(histogram, axis=axis)
    total = np.take(below, [-1], axis=axis)
    below = np.delete(below, -1, axis=axis)
    return np.concatenate([below, total - below], axis=axis)


def _score(inside: Any, failed_inside: Any, flights: Any, failures: Any) -> Floats:
    """Standard deviations by which the failures inside exceed what the hypergeometric law expects."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = inside / flights
        variance = (
            failures * share * (1.0 - share) * (flights - failures) / np.maximum(flights - 1.0, 1.0)
        )
        score = (failed_inside - failures * share) / np.sqrt(variance)
    return np.where(variance > 0.0, score, -np.inf)


def hypergeometric_tail(bad: int, flights: int, failures: int, inside: int) -> float:
    """Chance of at least ``bad`` of the ``failures`` among ``inside`` of the ``flights`` drawn at random."""

    def log_choose(n: Any, k: Any) -> Any:
        return gammaln(n + 1.0) - gammaln(k + 1.0) - gammaln(n - k + 1.0)

    k = np.arange(max(bad, inside + failures - flights), min(inside, failures) + 1)
    logs = (
        log_choose(failures, k)
        + log_choose(flights - failures, inside - k)
        - log_choose(flights, inside)
    )
    return float(np.exp(logs).sum())


def _p_values(candidates: list["_Candidate"]) -> Floats:
    """Exact chance of so many failures inside, the larger where there are two tables, times the candidates tried."""
    rows = np.array(
        [table for candidate in candidates for table in candidate.tables], dtype=np.int64
    )
    tails = [
        hypergeometric_tail(bad, flights, failures, inside)
        for inside, bad, flights, failures in rows.tolist()
    ]
    owners = np.repeat(
        np.arange(len(candidates)), [len(candidate.tables) for candidate in candidates]
    )
    largest = np.zeros(len(candidates))
    np.maximum.at(largest, owners, tails)
    return np.minimum(largest * np.array([candidate.tried for candidate in candidates]), 1.0)


@dataclass(frozen=True)
class _Candidate:
    """The best region of an input or a pair: flights and failures inside it and in all that it is held against."""

    conditions: tuple[Condition, ...]
    tables: tuple[tuple[int, int, int, int], ...]  # inside, failures inside, flights, failures
    tried: int
    either: bool = False


def _condition(inputs: tuple[int, ...], side: int, edges: Floats) -> Condition:
    lines = len(edges)
    return Condition(inputs[0], side >= lines, float(edges[side % lines]), *inputs[1:])


def _along(
    inputs: tuple[int, ...],
    bins: NDArray[np.uint8],
    failed: NDArray[np.bool_],
    edges: Floats,
    others: int = 1,
) -> list[_Candidate]:
    """The best half-line below, the best above, and both ends together where each holds more than chance.

    Of one input, or of the difference of two, of which `others` are tried.
    """
    inside = _sides(np.bincount(bins, minlength=_BINS), 0)
    bad = _sides(np.bincount(bins[failed], minlength=_BINS), 0)
    flights, failures = failed.size, int(failed.sum())
    score = _score(inside, bad, flights, failures)
    lines = _BINS - 1
    candidates = []
    for first in (0, lines):
        side = first + int(np.argmax(score[first : first + lines]))
        table = (int(inside[side]), int(bad[side]), flights, failures)
        candidates.append(_Candidate((_condition(inputs, side, edges),), (table,), lines * others))
    low, high = np.triu_indices(lines, 1)
    both, bad_both = inside[low] + inside[lines + high], bad[low] + bad[lines + high]
    best = int(np.argmax(_score(both, bad_both, flights, failures)))
    ends = int(low[best]), lines + int(high[best])
    needed = tuple(
        (
            int(inside[side]),
            int(bad[side]),
            flights - int(inside[other]),
            failures - int(bad[other]),
        )
        for side, other in (ends, ends[::-1])
    )
    conditions = tuple(_condition(inputs, side, edges) for side in ends)
    if float(np.min(_score(*np.array(needed).T))) < _CLEAR:
        return candidates
    if (
        float(_p_values([_Candidate(conditions, needed, low.size * others)])[0])
        <= FALSE_DISCOVERY_RATE
    ):
        table = (int(both[best]), int(bad_both[best]), flights, failures)
        candidates.append(_Candidate(conditions, (table,), low.size * others, either=True))
    return candidates


def _joint_counts(bins: NDArray[np.uint8]) -> NDArray[np.int64]:
    """How many flights fall into each pair of bins of each pair of inputs: [input, bin, input, bin]."""
    flights, count = bins.shape
    cells = len(_DECILES) + 1
    total = np.zeros((count * cells, count * cells))
    for start in range(0, flights, _CHUNK):
        part = bins[start : start + _CHUNK]
        marks = np.zeros(
            (part.shape[0], count * cells), dtype=np.float32
        )  # sums to _CHUNK stay exact
        marks[np.arange(part.shape[0])[:, None], np.arange(count) * cells + part] = 1.0
        total += marks.T @ marks
    return total.reshape(count, cells, count, cells).astype(np.int64)


def _best_corners(
    bins: NDArray[np.uint8], failed: NDArray[np.bool_], edges: Floats
) -> list[_Candidate]:
    """The best corner of each pair of inputs (columns of `bins` and `edges`)."""
    first, second = np.triu_indices(bins.shape[1], 1)
    if not first.size:
        return []

    def sides(
        counts: NDArray[np.int64],
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Inside both conditions [pair, side, side], and inside one [pair, side, 1] and the other [pair, 1, side]."""
        pairs = counts[first, :, second, :]
        alone = _sides(pairs.sum(axis=2), 1)[:, :, None], _sides(pairs.sum(axis=1), 1)[:, None, :]
        return _sides(_sides(pairs, 1), 2), *alone

    inside, in_first, in_second = sides(_joint_counts(bins))
    bad, bad_first, bad_second = sides(_joint_counts(bins[failed]))
    score = np.minimum(
        _score(inside, bad, in_first, bad_first), _score(inside, bad, in_second, bad_second)
    )
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
            _condition((int(first[k]),), a, edges[:, first[k]]),
            _condition((int(second[k]),), b, edges[:, second[k]]),
        )
        candidates.append(_Candidate(conditions, tables, tried))
    return candidates


def _sharpen(rule: Rule, failed: NDArray[np.bool_], column: Callable[[int], Floats]) -> Rule:
    """The rule of a half-line or of both ends with each threshold moved, between quantiles, to where failures begin.

    The p-value stays that of the quantiles, which were chosen without looking so close.
    """
    if len(rule.conditions) > 1 and not rule.either:
        return rule
    conditions, inside = [], np.zeros(failed.size, dtype=np.bool_)
    for condition in rule.conditions:
        values = _values(condition, column)
        order = np.argsort(
            -values if condition.above else values, kind="stable"
        )  # the most extreme first
        reached = int(np.sum(_meets(condition, values)))
        near = max(2, round(_NEAR * failed.size))
        tried = np.arange(max(1, reached - near), min(failed.size - 1, reached + near) + 1)
        tried = tried[
            values[order[tried - 1]] != values[order[tried]]
        ]  # equal values are on one side
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
    return replace(
        rule, conditions=tuple(conditions), failures_inside=hits, others_inside=size - hits
    )


def rule_mask(rule: Rule, column: Callable[[int], Floats]) -> NDArray[np.bool_]:
    """Return which flights [flight] lie in the region of a rule; ``column`` gives the values of an input."""
    masks = [_meets(condition, _values(condition, column)) for condition in rule.conditions]
    return np.logical_or.reduce(masks) if rule.either else np.logical_and.reduce(masks)


def _values(condition: Condition, column: Callable[[int], Floats]) -> Floats:
    if condition.minus is None:
        return column(condition.input)
    return _standardise(column(condition.input)) - _standardise(column(condition.minus))


def _standardise(values: Floats) -> Floats:
    """Values [flight] less their mean, in their standard deviations; they must vary."""
    return (values - np.mean(values)) / np.std(values)


def _meets(condition: Condition, values: Floats) -> NDArray[np.bool_]:
    return values > condition.threshold if condition.above else values <= condition.threshold
