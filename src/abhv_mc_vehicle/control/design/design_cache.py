"""Cache of design results that the controllers of a campaign share."""

import functools
import hashlib
import pickle
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_CAPACITY = 8


def cache_results(function: Callable[P, T]) -> Callable[P, T]:
    """Cache the most recent results of a function, keyed by the contents of its arguments.

    The cached results are shared and must not be modified.
    """
    results: dict[bytes, T] = {}

    @functools.wraps(function)
    def wrapper(*arguments: P.args, **named: P.kwargs) -> T:
        digest = hashlib.sha256(pickle.dumps((arguments, named), protocol=5)).digest()
        if digest not in results:
            result = function(*arguments, **named)
            if len(results) == _CAPACITY:
                del results[next(iter(results))]
            results[digest] = result
        return results[digest]

    return wrapper
