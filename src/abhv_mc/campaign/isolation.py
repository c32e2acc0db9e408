"""Where threads end and processes begin.

Compiled flights fly in worker processes by default: a crash in compiled code takes its process along, and what
protects against that is a process. Threads cost a second less at the start and protect against flights that raise only.
"""

import contextlib
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.batches import Fly
from abhv_mc.campaign.config import PROCESSES, Execution
from abhv_mc.campaign.guard import Guard, start_server
from abhv_mc.campaign.rescue import call_attempt, fly_rescued
from abhv_mc.campaign.setup import Engine
from abhv_mc.flight.plan import FlightBlock, FlightPlan

__all__ = ["guard_flights", "start_server"]


@contextlib.contextmanager
def guard_flights(engine: Engine, execution: Execution, workers: int) -> Iterator[Fly]:
    """A ``fly`` that threads may call side by side, and that gives ``failed_to_run`` for what cannot be computed."""
    isolation = engine.isolation if execution.isolation == "auto" else execution.isolation
    if isolation == PROCESSES:
        with contextlib.closing(Guard(engine.fly, workers, execution.flight_time_limit)) as guard:
            yield guard.fly
    else:

        def fly(plan: FlightPlan, parameters: NDArray[np.float64], every: int | None = None) -> FlightBlock:
            return fly_rescued(lambda rows: call_attempt(engine.fly, plan, rows, every), plan, parameters, every)

        yield fly
