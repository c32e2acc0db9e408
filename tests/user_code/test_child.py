"""The process beside this one: what it is called for ends with it, however early."""

import threading
import time

from abhv_mc.user_code.child import called_beside


def test_a_call_that_is_left_ends_without_an_error(monkeypatch):
    """A run that was refused at once closed the pipe under the thread that wrote to it."""
    raised = []
    monkeypatch.setattr(threading, "excepthook", raised.append)
    for _ in range(5):
        with called_beside(time.sleep, 600.0):
            pass
    assert not raised
