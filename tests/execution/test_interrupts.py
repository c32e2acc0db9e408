"""Signals that interrupt a run, or wait until a block is stored."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor

import pytest

from abhv_mc.execution.interrupts import interrupts_deferred, sigterm_as_interrupt

BOTH = (signal.SIGINT, signal.SIGTERM)


@pytest.fixture(autouse=True)
def handlers():
    """Handle Ctrl-C as usual, which a background job ignores, and note unhandled SIGTERM."""
    noted = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    other = signal.signal(signal.SIGTERM, lambda *_: noted.append("SIGTERM"))
    yield noted
    signal.signal(signal.SIGINT, before)
    signal.signal(signal.SIGTERM, other)


def handlers_now():
    return [signal.getsignal(number) for number in BOTH]


def test_sigterm_interrupts_only_in_the_context(handlers):
    before = handlers_now()
    with pytest.raises(KeyboardInterrupt), sigterm_as_interrupt():
        os.kill(os.getpid(), signal.SIGTERM)
    assert handlers_now() == before and not handlers
    os.kill(os.getpid(), signal.SIGTERM)
    assert handlers == ["SIGTERM"]


@pytest.mark.parametrize("number", BOTH)
def test_interrupts_wait_for_the_end_of_the_context(handlers, number):
    before, steps = handlers_now(), []

    def store():
        os.kill(os.getpid(), number)
        steps.append("stored")

    with pytest.raises(KeyboardInterrupt), interrupts_deferred():
        store()
    assert steps == ["stored"] and handlers_now() == before and not handlers
    with interrupts_deferred():
        pass
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with interrupts_deferred():
        os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("context", [sigterm_as_interrupt, interrupts_deferred])
def test_contexts_of_other_threads_leave_signals_alone(context):
    def enter():
        with context():
            return handlers_now()

    with ThreadPoolExecutor(1) as threads:
        assert threads.submit(enter).result() == handlers_now()
