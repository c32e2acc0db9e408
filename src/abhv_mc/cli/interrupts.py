"""Ctrl-C and SIGTERM end every command alike, and at any moment: what was done is kept, the exit code is 3."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator

from abhv_mc.execution.interrupts import sigterm_as_interrupt

_AGAIN = 0.01  # s


@contextlib.contextmanager
def heed_signals() -> Iterator[None]:
    """Let SIGTERM interrupt as Ctrl-C does, and let no interrupt get lost."""
    hook = sys.unraisablehook

    def interrupt_again(unraisable: "sys.UnraisableHookArgs") -> None:
        """Python drops what is raised in a finalizer, even a KeyboardInterrupt: send it once more."""
        if isinstance(unraisable.exc_value, KeyboardInterrupt):
            threading.Timer(_AGAIN, os.kill, (os.getpid(), signal.SIGTERM)).start()
        else:
            hook(unraisable)

    sys.unraisablehook = interrupt_again
    try:
        with sigterm_as_interrupt():
            yield
    finally:
        sys.unraisablehook = hook


def settle_interrupt() -> None:
    """Leave with an exit code after an interrupt: one that hit exec or eval would have Python die by its signal."""
    eval("0")  # noqa: S307  # the next one that runs to its end makes Python forget it


def ignore_signals() -> None:
    """From here on the process ends by itself."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
