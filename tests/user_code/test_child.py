"""The process and the thread beside this one: what they are called for ends with them, and Ctrl-C reaches who waits."""

import os
import signal
import threading
import time

import pytest

from abhv_mc.cli import flying
from abhv_mc.shipped import find_input
from abhv_mc.user_code.child import called_beside, run_in_thread


def test_a_call_that_is_left_ends_without_an_error(monkeypatch):
    """A run that was refused at once closed the pipe under the thread that wrote to it."""
    raised = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    for _ in range(5):
        with called_beside(time.sleep, 600.0):
            pass
    assert not raised


def test_a_limit_and_an_interrupt_end_the_wait_for_a_thread(monkeypatch):
    ended = threading.Event()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def never(*given, **options):
        assert threading.current_thread() is not threading.main_thread()
        os.kill(os.getpid(), signal.SIGINT)  # as a terminal does
        ended.wait()

    try:
        with pytest.raises(KeyboardInterrupt):
            run_in_thread(never)
        monkeypatch.setattr("abhv_mc.flight.fly.fly", never)
        with pytest.raises(KeyboardInterrupt):
            flying.fly(find_input("level", "mission"), controllers="lqr")
        with pytest.raises(TimeoutError):
            run_in_thread(ended.wait, 0.05)
    finally:
        ended.set()
        signal.signal(signal.SIGINT, before)
