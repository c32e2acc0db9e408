"""Loop of a worker process, run in this process."""

import signal

import numpy as np
import pytest
from fake_flight import fly, make_plan

from abhv_mc.custom_code import child
from abhv_mc.execution import worker
from abhv_mc.identity import this_flyer
from abhv_mc_vehicle.flight.fly import nominal_parameters

SIGNALS = (signal.SIGPROF, signal.SIGINT, signal.SIGTERM)


@pytest.fixture
def as_worker(monkeypatch):
    """Restore what a worker process changes: its signals, and the leave to run native code."""
    before = {number: signal.getsignal(number) for number in SIGNALS}
    monkeypatch.setattr(child, "_may_run", False)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Connection:
    """Parent's end of the pipe: jobs to receive, and the messages that were sent."""

    def __init__(self, *jobs):
        self.jobs, self.sent = iter(jobs), []

    def recv(self):
        if (job := next(self.jobs, None)) is None:
            raise EOFError
        return job

    def send(self, message):
        self.sent.append(message)


def test_a_worker_flies_its_plans_within_time_limits(as_worker, monkeypatch):
    """Limits are for 16 flights; each plan's nominal flight gives the limit that a job omits."""
    flown, measured, timers, started = [], [], [], []
    plans = {7: make_plan("one"), 8: make_plan("two", 2.0)}

    def fly_and_note(plan, parameters, recorded=None):
        if len(parameters) == 5:
            raise ValueError("five")
        flown.append((plan.controller, len(parameters)))
        return fly(plan, parameters, recorded)

    def usual_limit(fly, plan, clock):
        measured.append(plan.controller)
        return 100.0 * plan.gains[0, 0]

    monkeypatch.setattr(worker, "usual_limit", usual_limit)
    monkeypatch.setattr(worker.signal, "setitimer", lambda kind, limit: timers.append(limit))
    monkeypatch.setattr(worker.threading.Thread, "start", lambda self: started.append(self.daemon))
    jobs = (
        *((7, True, 3, 50.0), (7, False, 17, 50.0), (7, False, 5, 50.0)),
        *((8, True, 300, None), (8, False, 16, None), (7, False, 2, None), (9, False, 1, 1.0)),
    )
    connection = Connection(
        *(
            (key, plans[key] if is_new else None, nominal_parameters(flights), None, limit)
            for key, is_new, flights, limit in jobs
        )
    )
    worker.serve(connection, fly_and_note)
    sent = [entry if isinstance(entry, (float, str)) else None for entry in connection.sent]
    assert sent == [
        *(50.0, None, 100.0, None, 50.0, "ValueError: five"),
        *(3200.0, 3200.0, None, 200.0, None, 100.0, None, "KeyError: 9"),
    ]
    assert timers == [
        *(50.0, 0.0, 100.0, 0.0, 50.0, 0.0, 3200.0, 3200.0, 0.0, 200.0, 0.0, 100.0, 0.0, 0.0)
    ]
    # A new plan with a limit is loaded by a call without flights.
    assert flown[:3] == [("one", 0), ("one", 3), ("one", 17)]
    assert flown[3:] == [("two", 256), ("two", 44), ("two", 16), ("one", 2)]
    assert measured == ["two", "one"] and started == [True]
    blocks = [entry for entry in connection.sent if not isinstance(entry, (float, str))]
    for block, key, flights in zip(blocks, (7, 7, 8, 8, 7), (3, 17, 300, 16, 2), strict=True):
        expected = fly(plans[key], nominal_parameters(flights))
        np.testing.assert_array_equal(block.metrics, expected.metrics)
        assert set(block.flown_by) == {this_flyer()}
    assert child.may_run_here()
    handlers = [signal.getsignal(number) for number in SIGNALS]
    assert handlers == [signal.SIG_DFL, signal.SIG_IGN, signal.SIG_DFL]


def test_a_worker_ends_with_its_parent(monkeypatch):
    ended, waited = [], []
    monkeypatch.setattr(worker, "wait", waited.append)
    monkeypatch.setattr(worker.os, "_exit", ended.append)
    worker._end_with_parent()  # this process has no parent that it could wait for
    assert not ended
    parent = type("Parent", (), {"sentinel": 5})
    monkeypatch.setattr(worker, "parent_process", lambda: parent)
    worker._end_with_parent()
    assert waited == [[5]] and ended == [1]
