"""Flights on a Dask cluster: each block is a task, and plans are sent as arrays.

If a worker dies, Dask runs its block on another worker. A block that terminates several workers is
reported as lost and computed in smaller pieces (see :mod:`abhv_mc.execution.retry`). Workers may
join and leave during a campaign.
"""

import logging
import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import allow_here
from abhv_mc.execution.attestation import sign
from abhv_mc.execution.retry import (
    BATCH_FLIGHTS,
    FlightLostError,
    UnusableError,
    fly_in_batches,
    make_failed,
    time_limit,
)
from abhv_mc.external_simulators.user_flights import note_surplus, with_surplus
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.identity import code_hash
from abhv_mc.interfaces import Engine, Fly, OpenExecutor, Recorded
from abhv_mc.io.messages import InputError, notify
from abhv_mc_vehicle.flight.plan import FlightPlan
from abhv_mc_vehicle.flight.plan_arrays import flatten
from abhv_mc_vehicle.kernel.jit import set_compile_listener
from abhv_mc_vehicle.user_code.law_source import refuse_platform
from abhv_mc_vehicle.vehicle_simulator.stored_plans import Code, code_of, rebuild_sent

if TYPE_CHECKING:
    from distributed import Client, Future

Arrays = dict[str, np.ndarray]

_LIMIT = 600.0  # time limit in s for one flight, or for 16 flights of a batch
_CONNECT = 10.0  # time limit in s for connecting to the scheduler
_PER_THREAD = 2  # number of blocks submitted per worker thread, so that threads need not wait
_MOST_PLANS = 32  # maximum number of plans stored on the cluster
_FEWEST = 16  # minimum number of submitted blocks, for workers that join later
_COMPILING = "abhv-mc-compiling"  # topic of the events by which workers report a compilation
_warm: set[tuple[str, bool, str, str]] = set()
_warming = threading.Lock()


def hold_plan(arrays: Arrays) -> Arrays:
    """Return the arrays of a plan unchanged.

    Because the arrays are the result of a task, Dask passes them between workers and restores them
    after a loss.
    """
    return arrays


def fly_remote(
    fly: Fly,
    source: str,
    arrays: Arrays,
    code: Code,
    parameters: Floats,
    recorded: Recorded,
    limit: float,
) -> FlightBlock:
    """Compute a block on a worker of the cluster, and sign it.

    A flight that exceeds the time limit terminates the process, which Dask treats as a dead worker.
    """
    plan = rebuild_sent(arrays, code)
    if source and code_hash() != source:
        # The parent process rejects this block, so the worker computes no flight.
        return sign(make_failed(plan, None))
    allow_here()
    if plan.source is not None and (problem := refuse_platform(plan.source)) is not None:
        raise UnusableError(f"a worker of the cluster has {problem}")
    with _warming:
        kind = (
            f"{plan.law} {plan.source_hash} {plan.channels_hash} {plan.vehicle.foreign.digest}",
            plan.lean,
            type(plan).__name__,
            fly.__qualname__,
        )
        if kind not in _warm:
            set_compile_listener(_report_compiling)
            fly(plan, plan.nominal, None)  # Loading and compilation do not count as flight time.
            _warm.add(kind)
    watch = _Watch(limit)
    try:
        return sign(fly_in_batches(fly, plan, parameters, recorded, watch.begin))
    finally:
        watch.end()


@contextmanager
def _report_compiling(_function: Any, elsewhere: bool) -> Iterator[None]:
    """Report to the launching command that this worker compiles, unless another worker does."""
    from distributed import get_worker

    with suppress(ValueError):  # The thread may not belong to a worker.
        worker = get_worker()
        if not elsewhere:
            worker.log_event(_COMPILING, worker.address)
    yield


def _print_compiling(event: tuple[float, str]) -> None:
    notify(
        f"worker {event[1]} compiles the flight code (a minute per machine and kind of campaign)"
    )


def fly_user_remote(
    fly: Fly, source: str, plan: FlightPlan, parameters: Floats, recorded: Recorded
) -> FlightBlock:
    """Compute a block of a custom simulator on a worker of the cluster, and sign it.

    The files of the simulator must be installed on the worker.
    """
    if source and code_hash() != source:
        raise UnusableError(
            "a worker of the cluster has another version of abhv-mc; restart the worker with the "
            "version used by this command"
        )
    try:
        return sign(fly(plan, parameters, recorded))
    except InputError as error:
        raise UnusableError(f"a worker of the cluster failed ({error})") from None


class _Watch:
    """Timer that ends the process if a batch takes longer than ``limit`` seconds."""

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._timer = threading.Timer(limit, os._exit, (1,))

    def begin(self) -> None:
        self._timer.cancel()
        self._timer = threading.Timer(self._limit, os._exit, (1,))
        self._timer.daemon = True
        self._timer.start()

    def end(self) -> None:
        self._timer.cancel()


class Cluster:
    """Executor on the workers of a Dask scheduler; :meth:`fly` is thread-safe."""

    def __init__(self, client: "Client", engine: Engine, limit: float | None) -> None:
        self._client = client
        self._engine = engine
        self._limit = limit or _LIMIT
        # Future and plan by id of the plan; the stored reference keeps the id unique.
        self._plans: dict[int, tuple[Future, FlightPlan]] = {}
        self._lock = threading.Lock()

    @property
    def workers(self) -> int:
        """Number of blocks to compute at the same time."""
        return max(_FEWEST, _PER_THREAD * sum(self._client.nthreads().values()))

    def fly(self, plan: Any, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute a block on the cluster. Raise FlightLostError or UnusableError."""
        if not self._engine.records_lost:
            return self._attempt(plan, parameters, recorded)
        block = self._attempt(with_surplus(plan), parameters, recorded)
        note_surplus(plan, len(parameters), block.events.get("surplus", 0))
        return block

    def close(self) -> None:
        """Release the plans; :func:`connect_cluster` closes the connection."""
        self._plans.clear()

    def _send_plan(self, plan: FlightPlan) -> "Future":
        """Return the future of a plan on the cluster; a plan that Dask lost is sent again."""
        with self._lock:
            future, _ = self._plans.get(id(plan), (None, plan))
            if future is None or future.status == "error":
                # Release the oldest plans; running tasks keep their plans.
                while len(self._plans) >= _MOST_PLANS:
                    del self._plans[next(iter(self._plans))]
                future = self._client.submit(hold_plan, flatten(plan), pure=False)
                self._plans[id(plan)] = future, plan
            return future

    def _attempt(self, plan: Any, parameters: Floats, recorded: Recorded) -> FlightBlock:
        from distributed import CancelledError, KilledWorker

        engine = self._engine
        limit = time_limit(min(len(parameters), BATCH_FLIGHTS), self._limit)
        source = engine.source if engine.checked else ""
        if not isinstance(plan, FlightPlan):
            future = self._client.submit(
                fly_user_remote, engine.fly, source, plan, parameters, recorded, pure=False
            )
        else:
            arguments = self._send_plan(plan), code_of(plan), parameters, recorded, limit
            future = self._client.submit(fly_remote, engine.fly, source, *arguments, pure=False)
        try:
            block: FlightBlock = future.result()
            return block
        except UnusableError:
            raise
        except KilledWorker as error:
            raise FlightLostError(
                "several workers of the cluster terminated while computing the block "
                f"({error.last_worker.address})",
                process=True,
            ) from None
        except (CancelledError, OSError) as error:
            raise UnusableError(
                f"the connection to the cluster was lost ({type(error).__name__}: {error})"
            ) from None
        except Exception as error:
            raise FlightLostError(f"{type(error).__name__}: {error}") from None


@contextmanager
def connect_cluster(address: str) -> Iterator[OpenExecutor]:
    """Yield the function that opens executors on the scheduler at ``address``.

    Raise InputError if Dask is not installed or no scheduler answers.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--scheduler",
            "Dask is not installed",
            "the packages dask and distributed (pip install dask distributed)",
        ) from None
    try:
        client: Any = Client(address, timeout=_CONNECT, set_as_default=False)
    except Exception as error:  # Another program at this address may send any reply.
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            "--scheduler",
            f"no scheduler at '{address}' ({reason})",
            "an address such as tcp://host:8786",
        ) from None
    # The client need not log connection errors, because abhv-mc reports them.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with client:
        client.subscribe_topic(_COMPILING, _print_compiling)
        has_waited = False
        try:
            while not client.nthreads():
                if not has_waited:
                    notify(f"waiting for workers at {address}")
                    has_waited = True
                time.sleep(0.2)
            yield partial(Cluster, client)
        except (OSError, RuntimeError) as error:  # Dask has no common base class of errors.
            if client.status == "running":
                raise
            raise UnusableError(
                f"the scheduler at {address} does not answer ({type(error).__name__}: {error}); "
                "completed flights are kept, and the same command resumes the run"
            ) from None
