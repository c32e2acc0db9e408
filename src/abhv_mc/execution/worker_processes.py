"""Worker processes that a flight may hang or kill: the parent watches them, replaces them and flies the rest.

A thread of the parent waits for each process, and each process has a pipe of its own: one that is killed while it sends
its result disturbs no other.
"""

import contextlib
import multiprocessing
import os
import queue
import signal
import sys
import threading
import time
import types
from collections.abc import Iterator
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from abhv_mc.array_types import Floats
from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.execution.worker import serve, usual_limit
from abhv_mc.flight.child_flights import describe_last_tick
from abhv_mc.flight.plan import FlightBlock, FlightPlan
from abhv_mc.flight.user_law import must_run_in_child
from abhv_mc.interfaces import Fly, Recorded
from abhv_mc.user_code.child import describe_exit

# Give up after 20 + workers consecutive failed starts (refused or SIGKILL counts 1, a crash 4).
_FAILED_STARTS = 20
_CRASH = 4
_PAUSE = 0.05  # s of waiting before a start, times the failed starts so far
_COMPILE_LIMIT = 600.0  # s for a process to start and to load or compile a flight
_RESPONSE_LIMIT = 60.0  # s for one that has done so to say that it begins the next block
_ASLEEP, _WALL = (
    600.0,
    20.0,
)  # s, and times the processor time: how long it may take, however busy the machine is
_start_lock = threading.Lock()


class _NotBegunError(Exception):
    """A worker process did not start, or ended before it began the flights it was sent: no flight's fault."""


def start_fork_server(fly: Fly) -> None:
    """Start the process that workers are forked from, which imports in the background what ``fly`` needs.

    Where it cannot be started, the first worker says why.
    """
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([serve.__module__, fly.__module__, "llvmlite.binding"])
    with contextlib.suppress(OSError), _starting_processes():
        forkserver.ensure_running()


class _Worker:
    """One process and the pipe to it. Raises OSError or EOFError where the process cannot be started."""

    def __init__(self, fly: Fly) -> None:
        context = multiprocessing.get_context("forkserver")
        self._connection, theirs = context.Pipe()
        with theirs:
            try:
                with _starting_processes():
                    self.process: BaseProcess = context.Process(
                        target=serve, args=(theirs, fly), daemon=True
                    )
                    self.process.start()
            except (OSError, EOFError):
                self._connection.close()
                raise
        self._plans: set[int] = set()  # keys of those it has
        self.has_flown = False

    def fly(
        self,
        key: int,
        plan: FlightPlan,
        parameters: Floats,
        recorded: Recorded,
        limit: float | None,
    ) -> FlightBlock:
        """Raises FlightLostError, and _NotBegunError where the process ended before these flights began."""
        known = key in self._plans
        try:
            self._connection.send((key, None if known else plan, parameters, recorded, limit))
            self._plans.add(key)
            answer = self._receive(_RESPONSE_LIMIT if known else _COMPILE_LIMIT)
        except (ConnectionError, FlightLostError):
            self.kill()
            raise _NotBegunError(describe_exit(self.process.exitcode)) from None
        self.has_flown = True
        while isinstance(answer, float):
            answer = self._receive(max(_ASLEEP, _WALL * answer), answer)
        if isinstance(answer, str):
            raise FlightLostError(answer)
        return answer

    def _receive(self, limit: float, processor: float = 0.0) -> Any:
        """What it sends within ``limit`` s, of which it may compute for ``processor`` s."""
        connection: Connection = self._connection
        if not wait([connection], limit):
            self.kill()
            words = f"not done in {limit:g} s{describe_last_tick(self.process.pid)}"
            raise FlightLostError(words, process=True, hung=True)
        try:
            return connection.recv()
        except (EOFError, OSError):
            self.kill()
            end = self.process.exitcode
            hung = end == -signal.SIGPROF
            words = (
                f"not done in {processor:g} s"
                if hung
                else f"its process ended: {describe_exit(end)}"
            )
            raise FlightLostError(
                words + describe_last_tick(self.process.pid), process=True, hung=hung
            ) from None

    def kill(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self._connection.close()


class WorkerPool:
    """Flies in worker processes, each started when first needed; threads may call :meth:`fly` side by side."""

    def __init__(self, fly: Fly, workers: int, limit: float | None) -> None:
        """``limit``: processor time for one flight, or for 16 in a batch, s."""
        self._fly, self.workers, self._limit = fly, workers, limit
        self._idle: queue.LifoQueue[_Worker | None] = queue.LifoQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._workers: set[_Worker] = set()
        self._plans: dict[
            int, tuple[int, FlightPlan]
        ] = {}  # by id; held, so that no id comes twice
        self._limits: dict[int, float | None] = {}  # by the plan's key
        self._lock, self._limiting = threading.Lock(), threading.Lock()
        self._most_failed_starts = _FAILED_STARTS + workers
        self._failed_starts = 0  # consecutive, weighed
        self._last_end = ""
        self._closed = False

    def fly(self, plan: FlightPlan, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute a block in a worker process. Raises FlightLostError and UnusableError."""
        with self._lock:
            key, _ = self._plans.setdefault(id(plan), (len(self._plans), plan))

        with self._limiting:
            if key not in self._limits:
                self._limits[key] = self._limit or self._find_limit(plan)
        return self._attempt(key, plan, parameters, recorded)

    def _find_limit(self, plan: FlightPlan) -> float | None:
        """Return the limit by a nominal flight here, once for all workers; None if each has to fly its own."""
        if must_run_in_child(plan):
            return None
        try:
            return usual_limit(self._fly, plan, time.thread_time)
        except Exception:  # a worker says what it is
            return None

    def _attempt(
        self, key: int, plan: FlightPlan, parameters: Floats, recorded: Recorded
    ) -> FlightBlock:
        worker = self._idle.get()
        try:
            while True:
                worker = worker or self._start()
                try:
                    block = worker.fly(key, plan, parameters, recorded, self._limits[key])
                except _NotBegunError as end:
                    self._remove(worker, str(end))
                    worker = None
                else:
                    self._failed_starts = 0
                    return block
        except FlightLostError as lost:
            if worker is not None and not worker.process.is_alive():
                self._remove(worker, str(lost))
                worker = None
            if self._closed:
                raise UnusableError("the campaign was stopped") from None
            raise
        finally:
            self._idle.put(worker)

    def _start(self) -> _Worker:
        while not self._closed:
            if self._failed_starts >= self._most_failed_starts:
                words = f"worker processes end before they fly ({self._last_end})"
                raise UnusableError(f"{words}; 'isolation: threads' does without them")
            time.sleep(_PAUSE * self._failed_starts)
            try:
                worker = _Worker(self._fly)
            except (
                OSError,
                EOFError,
            ) as error:  # the server is dying and not known to be dead, or cannot fork
                self._count_failed_start(
                    1, f"not started: {error or 'the server they are forked from ended'}"
                )
                continue
            with self._lock:
                self._workers.add(worker)
            if not self._closed:
                return worker
            worker.kill()
        raise UnusableError("the campaign was stopped")

    def _remove(self, worker: _Worker, end: str) -> None:
        worker.kill()
        with self._lock:
            self._workers.discard(worker)
        if not worker.has_flown:
            self._count_failed_start(
                1 if worker.process.exitcode == -signal.SIGKILL else _CRASH, end
            )

    def _count_failed_start(self, weight: int, end: str) -> None:
        with self._lock:
            self._failed_starts += weight
            self._last_end = end

    def close(self) -> None:
        """End every worker at once; flights under way are lost."""
        with self._lock:
            self._closed = True
            workers = list(self._workers)
        for worker in workers:
            with contextlib.suppress(OSError, ValueError):
                worker.process.kill()


@contextlib.contextmanager
def _starting_processes() -> Iterator[None]:
    """Processes that multiprocessing starts inside ignore Ctrl-C and import from where this one does.

    Ctrl-C reaches every process of the terminal: the parent decides. The caller's script is not run again. The server
    and its helper are started with ``python -c``, which would import from the working folder first: variables keep
    them from that.
    """
    searched = os.pathsep.join(map(os.path.abspath, sys.path))
    with _start_lock:
        main, before = sys.modules["__main__"], dict(os.environ)
        threads = before.get(
            "OPENBLAS_NUM_THREADS", "1"
        )  # further ones would spin on small matrices
        changed = {"PYTHONPATH": searched, "PYTHONSAFEPATH": "1", "OPENBLAS_NUM_THREADS": threads}
        os.environ.update(changed)
        resource_tracker.ensure_running()  # which unblocks signals when it starts
        mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        sys.modules["__main__"] = types.ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main
            signal.pthread_sigmask(signal.SIG_SETMASK, mask)
            for name in changed:
                del os.environ[name]
                os.environ.update({name: before[name]} if name in before else {})
