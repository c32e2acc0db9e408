"""Flights on a Dask cluster: each block is a task, and the plan travels with the work as plain arrays.

Dask flies a block whose worker died on another one; a block that ends several workers comes back as lost and is
flown in pieces (see :mod:`abhv_mc.execution.retry`). Workers may come and go while a campaign flies.
"""

import logging
import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.execution.attest import sign
from abhv_mc.execution.fly_batches import AT_ONCE, fly_in_batches
from abhv_mc.execution.retry import (
    FlightLostError,
    UnusableError,
    make_failed,
    time_limit,
)
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.folder.plan_file import flatten
from abhv_mc.identity import code_hash
from abhv_mc.interfaces import Engine, Fly, OpenExecutor, Recorded
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.jit import set_compile_listener
from abhv_mc.simulators.stored_plans import Code, code_of, rebuild_sent
from abhv_mc.simulators.user_simulator.user_flights import note_surplus, with_surplus
from abhv_mc.user_code.c_source import refuse_platform
from abhv_mc.user_code.child import allow_here

if TYPE_CHECKING:
    from distributed import Client, Future

Arrays = dict[str, np.ndarray]

_LIMIT = 600.0  # s that one flight, or 16 in a batch, may take
_CONNECT = 10.0  # s to find the scheduler
_PER_THREAD = (
    2  # blocks under way for each thread of the cluster, so that none waits for the next one
)
_MOST_PLANS = 32  # held on the cluster: `tune` has one for each candidate
_FEWEST = 16  # blocks under way at least: room for workers that join later
_COMPILING = "abhv-mc-compiling"  # topic of the events that workers send
_warm: set[tuple[str, bool, str, str]] = set()
_warming = threading.Lock()


def hold_plan(arrays: Arrays) -> Arrays:
    """A task whose result is its input: workers hand it on to each other, and Dask makes it anew where it is lost."""
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
    """What a worker of the cluster does: the block, signed.

    A flight that hangs ends its process: Dask takes it for a worker that died.
    """
    plan = rebuild_sent(arrays, code)
    if source and code_hash() != source:
        return sign(make_failed(plan, None))  # refused where it is merged, before it costs a flight
    allow_here()
    if plan.source is not None and (words := refuse_platform(plan.source)) is not None:
        raise UnusableError(f"a worker of the cluster has {words}")
    with _warming:
        kind = (
            f"{plan.law} {plan.source_hash} {plan.channels_hash} {plan.vehicle.foreign.digest}",
            plan.lean,
            type(plan).__name__,
            fly.__qualname__,
        )
        if kind not in _warm:
            set_compile_listener(_report_compiling)
            fly(plan, nominal_parameters(), None)  # loads or compiles, which is no flight's time
            _warm.add(kind)
    watch = _Watch(limit)
    try:
        return sign(fly_in_batches(fly, plan, parameters, recorded, watch.begin))
    finally:
        watch.end()


@contextmanager
def _report_compiling(_function: Any, elsewhere: bool) -> Iterator[None]:
    """Tell the launching command that this worker compiles; not that it waits for another one."""
    from distributed import get_worker

    with suppress(ValueError):  # no worker runs this thread
        worker = get_worker()
        if not elsewhere:
            worker.log_event(_COMPILING, worker.address)
    yield


def _print_compiling(event: tuple[float, str]) -> None:
    words = "compiles the flight (a minute, once per machine and kind of campaign)"
    print(f"worker {event[1]} {words}", file=sys.stderr, flush=True)


def fly_user_remote(
    fly: Fly, source: str, plan: FlightPlan, parameters: Floats, recorded: Recorded
) -> FlightBlock:
    """What a worker of the cluster does with a user's simulator, which lies there as here: the block, signed."""
    if source and code_hash() != source:
        raise UnusableError(
            "a worker of the cluster has another version of the program: start it anew"
        )
    try:
        return sign(fly(plan, parameters, recorded))
    except InputError as error:
        raise UnusableError(f"a worker of the cluster: {error}") from None


class _Watch:
    """Ends the process where a batch takes longer than ``limit``, s."""

    def __init__(self, limit: float) -> None:
        self._limit, self._timer = limit, threading.Timer(limit, os._exit, (1,))

    def begin(self) -> None:
        self._timer.cancel()
        self._timer = threading.Timer(self._limit, os._exit, (1,))
        self._timer.daemon = True
        self._timer.start()

    def end(self) -> None:
        self._timer.cancel()


class Cluster:
    """Flies on the workers of a scheduler; threads may call :meth:`fly` side by side."""

    def __init__(self, client: "Client", engine: Engine, limit: float | None) -> None:
        self._client, self._engine = client, engine
        self._limit = limit or _LIMIT
        self._plans: dict[int, tuple[Future, FlightPlan]] = {}  # held, so that no id comes twice
        self._lock = threading.Lock()

    @property
    def workers(self) -> int:
        """Blocks to have under way."""
        return max(_FEWEST, _PER_THREAD * sum(self._client.nthreads().values()))

    def fly(self, plan: Any, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute a block on the cluster. Raises FlightLostError and UnusableError."""
        if self._engine.close is None:
            return self._attempt(plan, parameters, recorded)
        block = self._attempt(with_surplus(plan), parameters, recorded)
        note_surplus(plan, len(parameters), block.events.get("surplus", 0))
        return block

    def close(self) -> None:
        """Forget the plans; the connection ends with :func:`connect_cluster`."""
        self._plans.clear()

    def _hold(self, plan: FlightPlan) -> "Future":
        """The plan on the cluster: held anew where Dask gave it up, as it does after workers that died with it."""
        with self._lock:
            held, _ = self._plans.get(id(plan), (None, plan))
            if held is None or held.status == "error":
                while (
                    len(self._plans) >= _MOST_PLANS
                ):  # the oldest; flights under way hold it on their own
                    del self._plans[next(iter(self._plans))]
                held = self._client.submit(hold_plan, flatten(plan), pure=False)
                self._plans[id(plan)] = held, plan
            return held

    def _attempt(self, plan: Any, parameters: Floats, recorded: Recorded) -> FlightBlock:
        from distributed import CancelledError, KilledWorker

        engine, limit = self._engine, time_limit(min(len(parameters), AT_ONCE), self._limit)
        source = engine.source if engine.checked else ""
        if engine.close is not None:
            future = self._client.submit(
                fly_user_remote, engine.fly, source, plan, parameters, recorded, pure=False
            )
        else:
            given = self._hold(plan), code_of(plan), parameters, recorded, limit
            future = self._client.submit(fly_remote, engine.fly, source, *given, pure=False)
        try:
            block: FlightBlock = future.result()
            return block
        except UnusableError:
            raise
        except KilledWorker as error:
            words = f"workers of the cluster ended on it ({error.last_worker.address})"
            raise FlightLostError(words, process=True) from None
        except (CancelledError, OSError) as error:
            raise UnusableError(f"the cluster is gone: {type(error).__name__}: {error}") from None
        except Exception as error:
            raise FlightLostError(f"{type(error).__name__}: {error}") from None


@contextmanager
def connect_cluster(address: str) -> Iterator[OpenExecutor]:
    """Yield what opens executors on the cluster whose scheduler is at ``address``. Raises InputError."""
    try:
        from distributed import Client
    except ImportError:
        wish = "pip install dask distributed"
        raise InputError("--scheduler", "no Dask in this installation", wish) from None
    try:
        client: Any = Client(address, timeout=_CONNECT, set_as_default=False)
    except Exception as error:  # of any kind, as whatever listens there may say anything
        found = (
            f"no scheduler at '{address}' ({(str(error) or type(error).__name__).splitlines()[0]})"
        )
        raise InputError("--scheduler", found, "an address such as tcp://host:8786") from None
    logging.getLogger("distributed.client").setLevel(
        logging.CRITICAL
    )  # the command says in words what went wrong
    with client:
        client.subscribe_topic(_COMPILING, _print_compiling)
        told = False
        try:
            while not client.nthreads():
                if not told:
                    print(f"waiting for workers of {address}", file=sys.stderr, flush=True)
                    told = True
                time.sleep(0.2)
            yield partial(Cluster, client)
        except (
            OSError,
            RuntimeError,
        ) as error:  # Dask raises these and others of no class of its own
            if client.status == "running":
                raise
            raise UnusableError(
                f"the scheduler at {address} is gone ({type(error).__name__}: {error}): "
                "completed flights are kept, and the same command resumes"
            ) from None
