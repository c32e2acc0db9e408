"""Main loop of a worker process, which simulates blocks and writes no files."""

import os
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING, Any

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import allow_here
from abhv_mc.execution.attestation import sign
from abhv_mc.execution.retry import BATCH_FLIGHTS, PIECE, fly_in_batches, time_limit
from abhv_mc.flights.blocks import FlightBlock

if TYPE_CHECKING:  # Worker processes do not import modules that only annotations need.
    from abhv_mc.interfaces import Fly, Recorded

_LEAST = 30.0  # minimum time limit in s for 16 flights
_TIMES = 20.0  # time limit as a multiple of the processor time of 16 nominal flights


def serve(connection: Connection, fly: "Fly") -> None:
    """Process jobs until the parent closes the connection.

    A job is (key of the plan, plan if new, parameters, recording, time limit). At the start of each
    batch, the worker sends its limit on processor time (s), after which SIGPROF ends the process.
    The last message is the block, or the error as text. The time limit of a job is for 16 flights;
    if it is None, the worker derives the limit from the nominal flight.
    """
    allow_here()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    # Ctrl-C reaches all processes of the terminal, and the parent handles it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    plans = {}
    usual = {}
    while True:
        try:
            key, plan, parameters, recorded, limit = connection.recv()
        except (EOFError, OSError):
            return
        try:
            if plan is not None:
                plans[key] = plan
                if limit is not None:  # Loading and compilation do not count as flight time.
                    fly(plan, plan.nominal[:0], None)
            if limit is None:
                if key not in usual:
                    usual[key] = usual_limit(fly, plans[key], time.process_time)
                limit = usual[key]
            allowed = time_limit(min(len(parameters), BATCH_FLIGHTS), limit)

            def begin(allowed: float = allowed) -> None:
                connection.send(allowed)
                signal.setitimer(signal.ITIMER_PROF, allowed)

            answer: FlightBlock | str = sign(
                fly_in_batches(fly, plans[key], parameters, recorded, begin)
            )
        except BrokenPipeError:
            return
        except Exception as error:
            answer = f"{type(error).__name__}: {error}"
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        connection.send(answer)


def compute(fly: "Fly", plan: Any, parameters: Floats, recorded: "Recorded" = None) -> FlightBlock:
    """Compute and sign a block; for executors whose processes may be lost."""
    allow_here()
    return sign(fly_in_batches(fly, plan, parameters, recorded))


def usual_limit(fly: "Fly", plan: Any, clock: Callable[[], float]) -> float:
    """Return the limit on processor time (s) for 16 flights, derived from the nominal flight.

    ``clock`` returns the elapsed processor time.
    """
    for _ in range(2):
        # The first flight may load or compile code, which does not count as flight time.
        start = clock()
        fly(plan, plan.nominal, None)
        if (limit := _TIMES * PIECE * (clock() - start)) < _LEAST:
            break
    return max(_LEAST, limit)


def _end_with_parent() -> None:
    """Make this process end when its parent ends, even while a flight hangs."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
