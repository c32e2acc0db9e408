"""What runs in a worker process: it flies what it is sent, and touches no file."""

import os
import signal
import threading
import time
from collections.abc import Callable
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait
from typing import TYPE_CHECKING

from abhv_mc.array_types import Floats
from abhv_mc.execution.attest import sign
from abhv_mc.execution.fly_batches import AT_ONCE, fly_in_batches
from abhv_mc.execution.retry import PIECE, time_limit
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.user_code.child import allow_here

if TYPE_CHECKING:  # which a worker process need not import
    from abhv_mc.interfaces import Fly, Recorded

_LEAST, _TIMES = (
    30.0,
    20.0,
)  # s for 16 flights, and times the processor time of 16 flights like the nominal one


def serve(connection: Connection, fly: "Fly") -> None:
    """Answer jobs (key of the plan, plan when it is new, parameters, what to record, limit) until the parent hangs up.

    Each is answered as each batch starts with the processor time (s) that it may take, after which SIGPROF ends the
    process, then with the block or what was raised. The limit is for 16 flights; None: by the nominal flight.
    """
    allow_here()
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches everyone in the terminal; the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    plans: dict[int, FlightPlan] = {}
    usual: dict[int, float] = {}
    while True:
        try:
            key, plan, parameters, recorded, limit = connection.recv()
        except (EOFError, OSError):
            return
        try:
            if plan is not None:
                plans[key] = plan
                if limit is not None:  # loads or compiles, which is no flight's time
                    fly(plan, nominal_parameters(0), None)
            if limit is None:
                if key not in usual:
                    usual[key] = usual_limit(fly, plans[key], time.process_time)
                limit = usual[key]
            allowed = time_limit(min(len(parameters), AT_ONCE), limit)

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


def compute(
    fly: "Fly", plan: FlightPlan, parameters: Floats, recorded: "Recorded" = None
) -> FlightBlock:
    """Return a block, signed: for executors that compute in processes of their own, which may be lost."""
    allow_here()
    return sign(fly_in_batches(fly, plan, parameters, recorded))


def usual_limit(fly: "Fly", plan: FlightPlan, clock: Callable[[], float]) -> float:
    """Return the processor time (s), by ``clock``, that 16 flights like the nominal one may take."""
    for _ in range(2):  # the first may load or compile, which is no flight's time
        start = clock()
        fly(plan, nominal_parameters(), None)
        if (limit := _TIMES * PIECE * (clock() - start)) < _LEAST:
            break
    return max(_LEAST, limit)


def _end_with_parent() -> None:
    """A flight that hangs would outlive a killed parent."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
