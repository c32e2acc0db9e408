"""Flights that never return: Ctrl-C reaches who waits for them."""

import os
import signal
import threading

import pytest

from abhv_mc.cli import flying
from abhv_mc.shipped import find_input
from abhv_mc.user_code.child import run_in_thread


@pytest.fixture
def never():
    """Work that waits for ever, and interrupts this process as a terminal does once it has begun."""
    ended = threading.Event()
    before = signal.signal(signal.SIGINT, signal.default_int_handler)

    def work(*given, **options):
        assert threading.current_thread() is not threading.main_thread()
        os.kill(os.getpid(), signal.SIGINT)
        ended.wait()

    yield work
    ended.set()
    signal.signal(signal.SIGINT, before)


def test_what_is_given_and_raised_comes_back():
    assert run_in_thread(lambda: None) is None and run_in_thread(lambda: 3, 10.0) == 3
    with pytest.raises(ZeroDivisionError):
        run_in_thread(lambda: 1 / 0)


def test_a_limit_and_an_interrupt(never):
    with pytest.raises(KeyboardInterrupt):
        run_in_thread(never)
    ended = threading.Event()
    with pytest.raises(TimeoutError):
        run_in_thread(ended.wait, 0.05)
    ended.set()


def test_a_flight_of_the_command_line_heeds_an_interrupt(never, monkeypatch, capsys):
    monkeypatch.setattr("abhv_mc.flight.fly.fly", never)
    with pytest.raises(KeyboardInterrupt):
        flying.fly(find_input("level", "mission"), controllers="lqr")
