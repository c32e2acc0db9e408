"""Messages about flight code that is being compiled."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Any

Listener = Callable[[Any, bool], AbstractContextManager[None]]
_listeners: list[Listener] = []


def listen(listener: Listener) -> None:
    """Set the context that is entered while this or another process compiles flight code."""
    _listeners[:] = [listener]


def tell(function: Any, elsewhere: bool) -> AbstractContextManager[None]:
    """Return the context in which this or another process compiles ``function``."""
    return _listeners[0](function, elsewhere) if _listeners else nullcontext()
