"""The smallest set of causes: which of many inputs, kept while the others go back to nominal, still make a failure.

Sets are tried in order of size as long as there are few enough of them; beyond, the whole set is shrunk until every
member is needed (delta debugging: Zeller & Hildebrandt, IEEE TSE 28(2), 2002), many candidates at a time.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Mask

Sets = list[tuple[int, ...]]

BUDGET = 4000  # candidates to try in order of size


@dataclass(frozen=True)
class Shrunk:
    """Sets of inputs that suffice, the one that fails worst first."""

    sets: tuple[tuple[int, ...], ...]
    smallest: bool  # every smaller set was tried and does not fail; else: no member can be left out
    tried: int


Shrinking = Generator[Sets, Floats, "Shrunk | None"]  # asks about sets, hears how badly each fails


def shrink(
    count: int,
    test: Callable[[NDArray[np.intp], Mask], Floats],
    mildest_first: Sequence[NDArray[np.intp]],
    budget: int = BUDGET,
) -> list[Shrunk | None]:
    """The smallest sets among ``count`` inputs of several failures, None where all inputs together do not fail.

    ``test`` takes which failure each candidate belongs to and the inputs that it keeps ``[candidate, input]``; it gives
    how badly each fails, -inf where it does not. What is asked about all failures at a time comes in one call.
    ``mildest_first`` orders the inputs for removal, for each failure.
    """
    found: list[Shrunk | None] = [None] * len(mildest_first)
    searches = [_shrink(count, order, budget) for order in mildest_first]
    asked = {who: next(search) for who, search in enumerate(searches)}
    while asked:
        turn, asked = asked, {}
        owners = np.repeat(
            np.array(list(turn), dtype=np.intp), [len(sets) for sets in turn.values()]
        )
        severity = test(
            owners, _masks([members for sets in turn.values() for members in sets], count)
        )
        for who in turn:
            try:
                asked[who] = searches[who].send(severity[owners == who])
            except StopIteration as end:
                found[who] = end.value
    return found


def _shrink(count: int, order: NDArray[np.intp], budget: int) -> Shrinking:
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
    kept = [int(i) for i in order]
    if not (yield [tuple(kept)])[0] > -np.inf:
        return None
    tried += 1
    while kept:
        without = [tuple(k for k in kept if k != i) for i in kept]
        severity = yield without
        tried += len(without)
        spare = [i for i, bad in zip(kept, severity, strict=True) if bad > -np.inf]
        if not spare:
            break
        # All that can leave alone, leaving together: one, two, ... of them, the mildest first.
        fewer = [tuple(k for k in kept if k not in spare[: n + 1]) for n in range(len(spare))]
        severity = yield fewer
        tried += len(fewer)
        kept = list(
            fewer[int(np.flatnonzero(severity > -np.inf).max())]
        )  # the first fails: it left alone
    return Shrunk((tuple(sorted(kept)),), len(kept) == size, tried)


def _masks(sets: Sets, count: int) -> Mask:
    keep = np.zeros((len(sets), count), dtype=np.bool_)
    for row, members in zip(keep, sets, strict=True):
        row[list(members)] = True
    return keep
