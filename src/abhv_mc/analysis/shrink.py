"""The smallest set of causes: which of many inputs, kept while the others go back to nominal, still make a failure.

Sets are tried in order of size as long as there are few enough of them; beyond, the whole set is shrunk until every
member is needed (delta debugging: Zeller & Hildebrandt, IEEE TSE 28(2), 2002), many candidates at a time.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

BUDGET = 4000  # candidates to try in order of size
_PIECE = 512  # candidates tried at once


@dataclass(frozen=True)
class Shrunk:
    """Sets of inputs that suffice, the one that fails worst first."""

    sets: tuple[tuple[int, ...], ...]
    smallest: bool  # every smaller set was tried and does not fail; else: no member can be left out
    tried: int


def shrink(count: int, test: Callable[[Mask], Floats], mildest_first: NDArray[np.intp], budget: int = BUDGET) -> Shrunk:
    """The smallest sets among ``count`` inputs that fail.

    ``test`` takes kept inputs ``[candidate, input]`` and gives how badly each candidate fails, -inf where it does not.
    ``mildest_first`` orders the inputs for removal. Raises ValueError where all inputs together do not fail.
    """
    tried, size = 0, 0
    while size <= count and tried + comb(count, size) <= budget:
        sets = list(combinations(range(count), size))
        severity = _test_sets(sets, count, test)
        tried += len(sets)
        found = sorted((k for k in range(len(sets)) if severity[k] > -np.inf), key=lambda k: -severity[k])
        if found:
            return Shrunk(tuple(sets[k] for k in found), True, tried)
        size += 1
    if size > count:
        raise ValueError("all inputs together do not fail")
    kept, flown = _shrink_whole(count, test, mildest_first)
    return Shrunk((kept,), len(kept) == size, tried + flown)


def _shrink_whole(count: int, test: Callable[[Mask], Floats], order: NDArray[np.intp]) -> tuple[tuple[int, ...], int]:
    """From all inputs down to a set that no single member can leave, and how many candidates that took."""
    kept = [int(i) for i in order]
    if not _test_sets([tuple(kept)], count, test)[0] > -np.inf:
        raise ValueError("all inputs together do not fail")
    tried = 1
    while kept:
        without = [tuple(k for k in kept if k != i) for i in kept]
        spare = [i for i, bad in zip(kept, _test_sets(without, count, test), strict=True) if bad > -np.inf]
        tried += len(without)
        if not spare:
            break
        # All that can leave alone, leaving together: one, two, ... of them, the mildest first.
        fewer = [tuple(k for k in kept if k not in spare[: n + 1]) for n in range(len(spare))]
        failing = np.flatnonzero(_test_sets(fewer, count, test) > -np.inf)
        tried += len(fewer)
        kept = list(fewer[int(failing.max())])  # the first fails: it left alone
    return tuple(sorted(kept)), tried


def _test_sets(sets: list[tuple[int, ...]], count: int, test: Callable[[Mask], Floats]) -> Floats:
    keep = np.zeros((len(sets), count), dtype=np.bool_)
    for row, members in zip(keep, sets, strict=True):
        row[list(members)] = True
    return np.concatenate([test(keep[first : first + _PIECE]) for first in range(0, len(sets), _PIECE)])
