"""Results of the design kept for equal arguments: the controllers of a campaign share their vehicle and mission."""

import functools
import hashlib
import pickle
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")
_KEPT = 8


class _Call:
    """Arguments that are equal where their contents are."""

    def __init__(self, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.arguments, self.named = arguments, named
        self.digest = hashlib.sha256(pickle.dumps((arguments, named), protocol=5)).digest()

    def __hash__(self) -> int:
        return hash(self.digest)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Call) and self.digest == other.digest


def kept(function: Callable[P, T]) -> Callable[P, T]:
    """The function, with the last few results kept: nobody may write to them."""

    @functools.lru_cache(_KEPT)
    def call(made: _Call) -> T:
        return function(*made.arguments, **made.named)

    @functools.wraps(function)
    def called(*arguments: P.args, **named: P.kwargs) -> T:
        return call(_Call(arguments, named))

    return called
