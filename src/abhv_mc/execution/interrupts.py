"""Handling of Ctrl-C and SIGTERM, which interrupt a run except while a block is stored."""

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def sigterm_as_interrupt() -> Iterator[None]:
    """Treat SIGTERM like Ctrl-C in the context if the context is opened in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Defer Ctrl-C and SIGTERM to the end of the context."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived = []
    before = {
        number: signal.signal(number, lambda received, frame: arrived.append(received))
        for number in (signal.SIGINT, signal.SIGTERM)
        if signal.getsignal(number)
        is not signal.SIG_IGN  # Background jobs of a shell must continue to ignore Ctrl-C.
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if arrived:
        raise KeyboardInterrupt
