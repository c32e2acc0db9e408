"""Floats that count their arithmetic operations, and arrays of such floats."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

COUNTS: Counter[str] = Counter()

_sqrt = math.sqrt


class Counted(float):
    """Float whose additions, subtractions, multiplications and divisions are counted."""

    __array_ufunc__ = None  # numpy's scalars use the arithmetic of this class
    __slots__ = ()

    def __neg__(self) -> "Counted":  # changes a bit; not counted
        return Counted(float.__neg__(self))

    def __abs__(self) -> "Counted":
        return Counted(float.__abs__(self))

    def __pow__(self, *_: Any) -> Any:
        raise TypeError("a power is not counted; write it as products")


def _counting(kind: str, name: str) -> Callable[[Counted, Any], Counted]:
    operation = getattr(float, name)

    def operate(x: Counted, y: Any) -> Counted:
        COUNTS[kind] += 1
        return Counted(operation(x, float(y)))

    return operate


for _kind, _names in {
    "additions": ("add", "sub"),
    "multiplications": ("mul",),
    "divisions": ("truediv",),
}.items():
    for _name in _names:
        for _full in (f"__{_name}__", f"__r{_name}__"):
            setattr(Counted, _full, _counting(_kind, _full))


def counted_sqrt(x: float) -> Counted:
    """Return the square root and count it."""
    COUNTS["square_roots"] += 1
    return Counted(_sqrt(x))


class CountedArray(np.ndarray):
    """Array whose assigned floats, also in its slices, become counted floats."""

    def __setitem__(self, index: Any, value: Any) -> None:
        super().__setitem__(index, Counted(value) if isinstance(value, float) else value)


def make_counted(values: Any) -> CountedArray:
    """Return an array of counted floats."""
    array = np.asarray(values, dtype=np.float64)
    counted = np.empty(array.shape, dtype=object).view(CountedArray)
    for index, value in np.ndenumerate(array):
        counted[index] = float(value)
    return counted
