"""What runs in a worker process: it flies what it is sent, and touches no file."""

import os
import signal
import threading
from functools import partial
from multiprocessing import parent_process
from multiprocessing.connection import Connection, wait

from abhv_mc.execution.attest import sign
from abhv_mc.execution.blocks import Fly, fly_recorded
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.user_code.child import allow_here


def serve(connection: Connection, fly: Fly) -> None:
    """Answer jobs (key of the plan, plan when it is new, parameters, what to record) until the parent hangs up.

    Each is answered with None as each batch starts, for the parent's clock, then the block or what was raised.
    """
    allow_here()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches everyone in the terminal; the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    plans: dict[int, FlightPlan] = {}
    while True:
        try:
            key, plan, parameters, recorded = connection.recv()
        except (EOFError, OSError):
            return
        try:
            if plan is not None:
                plans[key] = plan
                fly(plan, nominal_parameters(), None)  # loads or compiles, which is no flight's time
            begin = partial(connection.send, None)
            answer: FlightBlock | str = sign(fly_recorded(fly, plans[key], parameters, recorded, begin))
        except BrokenPipeError:
            return
        except Exception as error:
            answer = f"{type(error).__name__}: {error}"
        connection.send(answer)


def _end_with_parent() -> None:
    """A flight that hangs would outlive a killed parent."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
