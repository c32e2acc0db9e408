"""What flies the blocks: worker processes, threads of this process, or a cluster's workers.

Worker processes are the default: a crash in compiled code ends its process. Threads start a second sooner and survive
only flights that raise an exception.
"""

import contextlib
import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from abhv_mc.array_types import Floats
from abhv_mc.campaign.file.config import PROCESSES, THREADS, Execution
from abhv_mc.execution.attest import Attestation, sign
from abhv_mc.execution.blocks import choose_batch
from abhv_mc.execution.cluster import Cluster
from abhv_mc.execution.fly_batches import fly_in_batches
from abhv_mc.execution.retry import FlightLostError, fly_with_retries
from abhv_mc.execution.worker_processes import WorkerPool
from abhv_mc.flight.plan import FlightBlock, FlightPlan, join_blocks
from abhv_mc.identity import count_cores
from abhv_mc.interfaces import Engine, Fly, Recorded
from abhv_mc.io.input_error import InputError


@dataclass(frozen=True)
class Executor:
    """Flies blocks in parallel."""

    fly: (
        Fly  # threads may call it side by side; gives ``failed_to_run`` for what cannot be computed
    )
    workers: int  # calls to have under way

    def fly_side_by_side(
        self, plan: FlightPlan, parameters: Floats, recorded: Recorded = None
    ) -> FlightBlock:
        """Flights ``[flight, parameter]``, a share of them with each worker."""
        share = choose_batch(len(parameters), self.workers)
        pieces = [parameters[start : start + share] for start in range(0, len(parameters), share)]
        with open_threads(self.workers) as threads:
            return join_blocks(
                list(threads.map(lambda piece: self.fly(plan, piece, recorded), pieces))
            )


@contextlib.contextmanager
def open_threads(number: int) -> Iterator[ThreadPoolExecutor]:
    """Threads that, after an interrupt, wait for no flight: whoever flies them ends it."""
    threads = ThreadPoolExecutor(number)
    try:
        yield threads
    except BaseException:
        threads.shutdown(wait=False, cancel_futures=True)
        raise
    threads.shutdown()


@contextlib.contextmanager
def open_executor(
    engine: Engine,
    execution: Execution,
    workers: int | None,
    cluster: Cluster | None,
    check_workers: bool = False,
) -> Iterator[Executor]:
    """The executor that the campaign asks for; its worker processes end with the context.

    ``check_workers``: one flight of each worker is flown again here, and its bits compared.
    """
    check = Attestation(engine, check_workers).check
    limit = execution.flight_time_limit
    number = workers or execution.workers or count_cores()
    isolation = engine.isolation if execution.isolation == "auto" else execution.isolation
    if isolation == PROCESSES and multiprocessing.current_process().daemon:  # it may start none
        if execution.isolation == PROCESSES:
            found = (
                "worker processes inside a process of multiprocessing.Pool, which may start none"
            )
            wish = "'isolation: threads', or concurrent.futures.ProcessPoolExecutor"
            raise InputError("execution", found, wish)
        isolation = THREADS
    if cluster is not None:
        cluster.engine, cluster.limit = engine, limit or cluster.limit
        cluster.check = (
            check if engine.close is None else lambda _plan, _rows, block: block
        )  # its bits are its own
        yield Executor(cluster.fly, workers or cluster.room)
    elif isolation == PROCESSES:
        with contextlib.closing(WorkerPool(engine.fly, number, limit, check)) as pool:
            yield Executor(pool.fly, number)
    elif engine.close is not None:
        with contextlib.ExitStack() as stack:
            stack.callback(engine.close)
            yield Executor(lambda *given: sign(engine.fly(*given)), number)
    else:
        yield Executor(_in_this_process(engine), number)


def _in_this_process(engine: Engine) -> Fly:
    def fly(plan: FlightPlan, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        def attempt(rows: Floats, recorded: Recorded) -> FlightBlock:
            try:
                return sign(fly_in_batches(engine.fly, plan, rows, recorded))
            except Exception as error:
                raise FlightLostError(f"{type(error).__name__}: {error}") from error

        return fly_with_retries(attempt, plan, parameters, recorded)

    return fly
