"""A float that counts what is done with it, and arrays that hold nothing else."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

COUNTS: Counter[str] = Counter()

_sqrt = math.sqrt


class Counted(float):
    """A float whose additions, subtractions, multiplications and divisions are counted, and give such floats again."""

    __array_ufunc__ = None  # numpy's scalars leave the arithmetic to this class
    __slots__ = ()

    def __neg__(self) -> "Counted":  # a flipped bit, no operation
        return Counted(float.__neg__(self))

    def __abs__(self) -> "Counted":
        return Counted(float.__abs__(self))

    def __pow__(self, *_: Any) -> Any:
        raise TypeError("a power is not counted; write it as products")


def _counting(kind: str, name: str) -> Callable[[Counted, Any], Counted]:
    operation = getattr(float, name)

    def operate(one: Counted, other: Any) -> Counted:
        COUNTS[kind] += 1
        return Counted(operation(one, float(other)))

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
    """The square root, counted."""
    COUNTS["square_roots"] += 1
    return Counted(_sqrt(x))


class CountedArray(np.ndarray):
    """An array of objects that turns every float put into it into a counted one; so do its slices."""

    def __setitem__(self, at: Any, value: Any) -> None:
        super().__setitem__(at, Counted(value) if isinstance(value, float) else value)


def make_counted(values: Any) -> CountedArray:
    """An array of counted floats with the values of ``values``."""
    array = np.asarray(values, dtype=np.float64)
    counted = np.empty(array.shape, dtype=object).view(CountedArray)
    for at, value in np.ndenumerate(array):
        counted[at] = float(value)
    return counted
