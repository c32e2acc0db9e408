"""Where threads end and processes begin, and where another machine's do.

Compiled flights fly in worker processes by default: a crash in compiled code takes its process along, and what
protects against that is a process. Threads cost a second less at the start and protect against flights that raise only.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.file.config import PROCESSES, Execution
from abhv_mc.campaign.run.batches import Fly
from abhv_mc.campaign.run.cluster import Cluster
from abhv_mc.campaign.run.retry import call_attempt, fly_rescued
from abhv_mc.campaign.run.setup import Engine
from abhv_mc.campaign.run.worker_pool import Guard
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.store.provenance import count_cores


@dataclass(frozen=True)
class Crew:
    """Those who fly."""

    fly: Fly  # threads may call it side by side; gives ``failed_to_run`` for what cannot be computed
    workers: int  # calls to have under way


@contextlib.contextmanager
def hire_crew(engine: Engine, execution: Execution, workers: int | None, cluster: Cluster | None) -> Iterator[Crew]:
    """The workers of a cluster, worker processes, or threads."""
    limit = execution.flight_time_limit
    number = workers or execution.workers or engine.workers or count_cores()
    isolation = engine.isolation if execution.isolation == "auto" else execution.isolation
    if cluster is not None:
        cluster.limit = limit
        yield Crew(cluster.fly, workers or cluster.room)
    elif isolation == PROCESSES:
        with contextlib.closing(Guard(engine.fly, number, limit)) as guard:
            yield Crew(guard.fly, number)
    else:

        def fly(plan: FlightPlan, parameters: NDArray[np.float64], every: int | None = None) -> FlightBlock:
            return fly_rescued(lambda rows: call_attempt(engine.fly, plan, rows, every), plan, parameters, every)

        yield Crew(fly, number)
