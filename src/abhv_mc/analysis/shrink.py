"""Search for the smallest set of inputs that causes a failure if the others are nominal.

Candidate sets are tried in order of increasing size while their number is within a budget. Beyond
the budget, the full set is reduced until no single input can be omitted (delta debugging: Zeller &
Hildebrandt, IEEE TSE 28(2), 2002). Many candidates are tested at a time.
"""

from collections.abc import Callable, Generator, Sequence
from itertools import chain, combinations
from math import comb
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Indices, Mask

Sets = list[tuple[int, ...]]

BUDGET = 4000  # maximum number of candidate sets tried, smallest sets first


class Shrunk(NamedTuple):
    """Sets of inputs that cause the failure, most severe failure first."""

    sets: tuple[tuple[int, ...], ...]
    # True if no smaller set causes the failure, because all were tried. Otherwise no single input
    # can be omitted, but a smaller set may exist.
    smallest: bool
    tried: int


# The generator yields sets and receives the severity of each set.
Shrinking = Generator[Sets, Floats, "Shrunk | None"]


def shrink(
    count: int,
    test: Callable[[Indices, Mask], Floats],
    mildest_first: Sequence[Indices],
    budget: int = BUDGET,
) -> list[Shrunk | None]:
    """Return, for each failure, the smallest sets of inputs that cause it.

    The result is None for a failure that does not occur even if all inputs are included. `test`
    takes the failure index [candidate] and the input mask [candidate, input], and returns the
    severity of each candidate, or -inf without failure. Each call tests candidates of all failures.
    `mildest_first` contains, for each failure, the order in which inputs are removed.
    """
    results: list[Shrunk | None] = [None] * len(mildest_first)
    searches = [_shrink(count, order, budget) for order in mildest_first]
    pending = {index: next(search) for index, search in enumerate(searches)}
    while pending:
        turn, pending = pending, {}
        owners = np.repeat(np.array([*turn]), [len(sets) for sets in turn.values()])
        keep = np.zeros((len(owners), count), bool)
        for row, members in zip(keep, chain(*turn.values()), strict=True):
            row[[*members]] = True
        severity = test(owners, keep)
        for index in turn:
            try:
                pending[index] = searches[index].send(severity[owners == index])
            except StopIteration as end:
                results[index] = end.value
    return results


def _shrink(count: int, order: Indices, budget: int) -> Shrinking:
    tried, size = 0, 0
    while size <= count and tried + comb(count, size) <= budget:
        sets = list(combinations(range(count), size))
        severity = yield sets
        tried += len(sets)
        failing = sorted(
            (k for k in range(len(sets)) if severity[k] > -np.inf), key=lambda k: -severity[k]
        )
        if failing:
            return Shrunk(tuple(sets[k] for k in failing), True, tried)
        size += 1
    if size > count:
        return None
    inputs = [int(i) for i in order]
    if not (yield [tuple(inputs)])[0] > -np.inf:
        return None
    tried += 1
    while inputs:
        without = [tuple(k for k in inputs if k != i) for i in inputs]
        severity = yield without
        tried += len(without)
        spare = [i for i, bad in zip(inputs, severity, strict=True) if bad > -np.inf]
        if not spare:
            break
        # Try to remove one, two, ... of the individually removable inputs together, mildest first.
        fewer = [tuple(k for k in inputs if k not in spare[: n + 1]) for n in range(len(spare))]
        severity = yield fewer
        tried += len(fewer)
        inputs = list(
            fewer[np.flatnonzero(severity > -np.inf).max()]
        )  # The first set is known to fail, because it lacks only one removable input.
    return Shrunk((tuple(sorted(inputs)),), len(inputs) == size, tried)
