"""Regions of the inputs in which failures are significantly more frequent.

Regions are half-lines, unions of both ends, corners, and half-lines of differences of inputs, with
thresholds at the deciles and a few more extreme quantiles of the samples. A half-line is tested by
the exact hypergeometric distribution. A corner, or both ends of an input, counts only if each of
its two conditions raises the failure rate given the other condition, so that irrelevant inputs are
not combined with relevant inputs. A difference must be more significant than each of the two inputs
and their corner. The p-value of the best candidate of each input or pair is corrected for the
number of candidates (Bonferroni); the Benjamini-Hochberg procedure is applied to all inputs and
pairs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from abhv_mc.array_types import Floats, Ints, Mask
from abhv_mc.statistics.ranks import false_discovery

FALSE_DISCOVERY_RATE = 0.05
FEWEST_FAILURES = 5
_QUANTILES = (0.01, 0.02, 0.05, *(n / 10.0 for n in range(1, 10)), 0.95, 0.98, 0.99)
_BINS = len(_QUANTILES) + 1
_DECILES = [
    row for row, quantile in enumerate(_QUANTILES) if 0.1 <= quantile <= 0.9
]  # quantiles used as thresholds of corners
_COARSE = np.searchsorted(_DECILES, np.arange(_BINS)).astype(
    np.uint8
)  # index of the decile bin that contains each fine bin
# score, in standard deviations, below which the two ends of an input are not tested together
_CLEAR = 2.0
_DIFFERED = 6  # number of inputs, most related to failures, whose differences are tested
_MOST_RULES = 20
_CHUNK = 4096
_NEAR = 0.05  # largest shift of a threshold from its quantile, as a share of the flights


@dataclass(frozen=True)
class Condition:
    """Bound on an input, or on the difference of two standardized inputs."""

    parameter: str
    above: bool
    threshold: float
    minus: str | None = None  # subtracted input


@dataclass(frozen=True)
class Rule:
    """Region of the inputs in which failures are more frequent."""

    conditions: tuple[Condition, ...]
    failures_inside: int
    failures: int
    others_inside: int
    others: int
    p_value: float  # p-value, corrected for the number of candidates of the input or pair
    q_value: float  # smallest false-discovery rate at which the rule is significant
    either: bool = False  # whether one condition is enough; otherwise all must hold


class BinnedInputs(NamedTuple):
    """Inputs sorted into bins between quantiles."""

    names: tuple[str, ...]
    column: Callable[[str], Floats]  # function that returns the values [flight] of an input
    edges: Floats  # thresholds of each input [threshold, input]
    bins: NDArray[np.uint8]  # number of thresholds below each value [flight, input]


def bin_inputs(names: Sequence[str], column: Callable[[str], Floats]) -> BinnedInputs:
    """Sort inputs into bins, with one input in memory at a time.

    `column` returns the values [flight] of an input.
    """
    edges, bins = [], []
    for values in map(column, names):
        # Interpolation between a number and infinity is impossible.
        method: Literal["linear", "lower"] = "linear" if np.all(np.isfinite(values)) else "lower"
        edges.append(np.quantile(values, _QUANTILES, method=method))
        bins.append(np.searchsorted(edges[-1], values, side="left").astype(np.uint8))
    return BinnedInputs(tuple(names), column, np.stack(edges, axis=1), np.stack(bins, axis=1))


def find_rules(inputs: BinnedInputs, failed: Mask) -> list[Rule]:
    """Return the rules for the `failed` flights [flight], most significant first."""
    edges, bins = inputs.edges, inputs.bins
    flights, failures = failed.size, int(failed.sum())
    if failures < FEWEST_FAILURES or flights - failures < FEWEST_FAILURES:
        return []
    candidates = []
    for j, name in enumerate(inputs.names):
        candidates += _drop_ends(_along((name,), bins[:, j], failed, edges[:, j]))
    candidates += _best_corners(inputs, failed)
    candidates += _differences(candidates, failed, inputs)
    p_values = _p_values(candidates)
    rules = []
    for candidate, p_value, q_value in zip(
        candidates, p_values.tolist(), false_discovery(p_values).tolist(), strict=True
    ):
        if q_value <= FALSE_DISCOVERY_RATE:
            # All tables of a candidate have the same numbers of flights and failures in the region.
            inside, bad = map(int, candidate.tables[0][:2])
            rules.append(
                Rule(
                    conditions=candidate.conditions,
                    failures_inside=bad,
                    failures=failures,
                    others_inside=inside - bad,
                    others=flights - failures,
                    p_value=p_value,
                    q_value=q_value,
                    either=candidate.either,
                )
            )
    # Among rules with equal p-values, the rule with fewer conditions comes first.
    rules.sort(key=lambda rule: (rule.p_value, len(rule.conditions)))
    return [_sharpen(rule, failed, inputs.column) for rule in rules[:_MOST_RULES]]


def _drop_ends(candidates: list["_Candidate"]) -> list["_Candidate"]:
    """Keep the half-lines of each input, or the union of both ends if it is more significant."""
    if len(candidates) < 3:
        return candidates
    below, above, both = _p_values(candidates)
    return candidates[2:] if both < min(below, above) else candidates[:2]


def _differences(
    candidates: list["_Candidate"], failed: Mask, inputs: BinnedInputs
) -> list["_Candidate"]:
    """Return half-lines of differences that are more significant than rules for the inputs.

    Only differences between the inputs most related to failures are tested.
    """
    flights, failures, names = failed.size, int(failed.sum()), inputs.names
    pairs = len(names) * (len(names) - 1) // 2
    best: dict[frozenset[str], float] = {}
    # A rule for a difference must be more significant than the whole corner, not only than one of
    # its conditions.
    complete = [
        _Candidate(c.conditions, ((*c.tables[0][:2], flights, failures),), c.tried)
        for c in candidates
    ]
    for candidate, p_value in zip(candidates, _p_values(complete).tolist(), strict=True):
        key = frozenset(condition.parameter for condition in candidate.conditions)
        best[key] = min(best.get(key, 1.0), p_value)
    alone = sorted(
        (p_value, names.index(min(key))) for key, p_value in best.items() if len(key) == 1
    )
    standard = {}
    for _, j in alone[:_DIFFERED]:
        values = inputs.column(names[j])
        if np.isfinite(values).all() and np.ptp(values) > 0.0:
            standard[j] = _standardise(values)
    differences = []
    for i, j in combinations(sorted(standard), 2):
        first, second, values = names[i], names[j], standard[i] - standard[j]
        edges = np.quantile(values, _QUANTILES)
        bins = np.searchsorted(edges, values, side="left").astype(np.uint8)
        tried = _drop_ends(_along((first, second), bins, failed, edges, pairs))
        simpler_p_value = min(
            best.get(frozenset(key), 1.0) for key in ((first,), (second,), (first, second))
        )
        differences += [
            c
            for c, p_value in zip(tried, _p_values(tried).tolist(), strict=True)
            if p_value < simpler_p_value
        ]
    return differences


def _sides(histogram: Ints, axis: int) -> Ints:
    """Return counts at or below each threshold, then counts above it, along an axis of bins."""
    below = np.cumsum(histogram, axis=axis)
    total = np.take(below, [-1], axis=axis)
    below = np.delete(below, -1, axis=axis)
    return np.concatenate([below, total - below], axis=axis)


def _score(inside: Any, failed_inside: Any, flights: Any, failures: Any) -> Floats:
    """Return the excess of failures over the hypergeometric mean, in standard deviations."""
    with np.errstate(divide="ignore", invalid="ignore"):
        share = inside / flights
        variance = (
            failures * share * (1.0 - share) * (flights - failures) / np.maximum(flights - 1.0, 1.0)
        )
        score = (failed_inside - failures * share) / np.sqrt(variance)
    return np.where(variance > 0.0, score, -np.inf)


def hypergeometric_tail(bad: int, flights: int, failures: int, inside: int) -> float:
    """Return the chance of at least `bad` failures among `inside` flights drawn at random."""

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
    """Return each candidate's largest p-value over its tables, times the number of trials."""
    rows = np.array([table for candidate in candidates for table in candidate.tables])
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


class _Candidate(NamedTuple):
    """Best region of one or two inputs, with its counts of flights and reference counts."""

    conditions: tuple[Condition, ...]
    # tables of counts: flights in the region, failures in the region, all flights, all failures
    tables: tuple[tuple[int, int, int, int], ...]
    tried: int
    either: bool = False


def _condition(inputs: tuple[str, ...], side: int, edges: Floats) -> Condition:
    lines = len(edges)
    return Condition(inputs[0], side >= lines, float(edges[side % lines]), *inputs[1:])


def _along(
    inputs: tuple[str, ...],
    bins: NDArray[np.uint8],
    failed: Mask,
    edges: Floats,
    differences: int = 1,
) -> list[_Candidate]:
    """Return the best half-lines below and above a threshold, and both ends if significant.

    `inputs` is one input, or a pair of inputs whose difference is considered; `differences` is the
    number of such pairs.
    """
    inside = _sides(np.bincount(bins, minlength=_BINS), 0)
    bad = _sides(np.bincount(bins[failed], minlength=_BINS), 0)
    flights, failures = failed.size, int(failed.sum())
    score = _score(inside, bad, flights, failures)
    lines = _BINS - 1
    candidates = []
    for first in (0, lines):
        side = first + int(np.argmax(score[first : first + lines]))
        table = (inside[side], bad[side], flights, failures)
        candidates.append(
            _Candidate((_condition(inputs, side, edges),), (table,), lines * differences)
        )
    low, high = np.triu_indices(lines, 1)
    both, bad_both = inside[low] + inside[lines + high], bad[low] + bad[lines + high]
    best = np.argmax(_score(both, bad_both, flights, failures))
    ends = int(low[best]), lines + int(high[best])
    needed = tuple(
        (inside[side], bad[side], flights - inside[other], failures - bad[other])
        for side, other in (ends, ends[::-1])
    )
    conditions = tuple(_condition(inputs, side, edges) for side in ends)
    if np.min(_score(*np.array(needed).T)) < _CLEAR:
        return candidates
    tried = low.size * differences
    if _p_values([_Candidate(conditions, needed, tried)])[0] <= FALSE_DISCOVERY_RATE:
        table = (both[best], bad_both[best], flights, failures)
        candidates.append(_Candidate(conditions, (table,), tried, either=True))
    return candidates


def _joint_counts(bins: NDArray[np.uint8]) -> Ints:
    """Return the numbers of flights [input, bin, input, bin] in each pair of bins."""
    flights, count = bins.shape
    cells = len(_DECILES) + 1
    total = np.zeros((count * cells, count * cells))
    for start in range(0, flights, _CHUNK):
        chunk = bins[start : start + _CHUNK]
        marks = np.zeros(
            (chunk.shape[0], count * cells), np.float32
        )  # Sums of up to _CHUNK flights stay exact in single precision.
        marks[np.arange(chunk.shape[0])[:, None], np.arange(count) * cells + chunk] = 1.0
        total += marks.T @ marks
    return total.reshape(count, cells, count, cells).astype(np.int64)


def _best_corners(inputs: BinnedInputs, failed: Mask) -> list[_Candidate]:
    """Return the best corner of each pair of inputs, with thresholds at the deciles."""
    bins, edges, names = _COARSE[inputs.bins], inputs.edges[_DECILES], inputs.names
    first, second = np.triu_indices(len(names), 1)
    if not first.size:
        return []

    def sides(counts: Ints) -> tuple[Ints, Ints, Ints]:
        """Return counts of flights that meet both conditions [pair, side, side] or a single one.

        The counts for a single condition have the shapes [pair, side, 1] and [pair, 1, side].
        """
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
            _condition((names[first[k]],), a, edges[:, first[k]]),
            _condition((names[second[k]],), b, edges[:, second[k]]),
        )
        candidates.append(_Candidate(conditions, tables, tried))
    return candidates


def _sharpen(rule: Rule, failed: Mask, column: Callable[[str], Floats]) -> Rule:
    """Move each threshold of a half-line rule to the value at which failures begin.

    The p-value still applies to the quantiles, which were selected before this step.
    """
    if len(rule.conditions) > 1 and not rule.either:
        return rule
    conditions, inside = [], np.zeros(failed.size, bool)
    for condition in rule.conditions:
        values = _values(condition, column)
        order = np.argsort(
            -values if condition.above else values, kind="stable"
        )  # indices of the flights, sorted by value, starting inside the region
        size_inside = int(np.sum(_meets(condition, values)))
        near = max(2, round(_NEAR * failed.size))
        tried = np.arange(max(1, size_inside - near), min(failed.size - 1, size_inside + near) + 1)
        tried = tried[
            values[order[tried - 1]] != values[order[tried]]
        ]  # Equal values stay on one side of a threshold.
        if not tried.size:
            return rule
        bad = np.cumsum(failed[order])[tried - 1]
        worth = bad / rule.failures - (tried - bad) / rule.others
        count = int(tried[np.argmax(worth)])
        inside_end, outside_end = float(values[order[count - 1]]), float(values[order[count]])
        threshold = (inside_end + outside_end) / 2.0
        if not np.isfinite(threshold):  # The time of a failure that never occurs is infinite.
            threshold = outside_end if condition.above else inside_end
        conditions.append(replace(condition, threshold=threshold))
        inside |= _meets(conditions[-1], values)
    hits, size = int(np.sum(inside & failed)), int(inside.sum())
    return replace(
        rule, conditions=tuple(conditions), failures_inside=hits, others_inside=size - hits
    )


def condition_mask(condition: Condition, column: Callable[[str], Floats]) -> Mask:
    """Return a mask [flight] of the flights that meet a condition."""
    return _meets(condition, _values(condition, column))


def _values(condition: Condition, column: Callable[[str], Floats]) -> Floats:
    if condition.minus is None:
        return column(condition.parameter)
    return _standardise(column(condition.parameter)) - _standardise(column(condition.minus))


def _standardise(values: Floats) -> Floats:
    """Scale values [flight], which must vary, to zero mean and unit standard deviation."""
    return (values - np.mean(values)) / np.std(values)


def _meets(condition: Condition, values: Floats) -> Mask:
    return values > condition.threshold if condition.above else values <= condition.threshold
