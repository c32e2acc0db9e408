"""Worker processes that a flight may hang or kill: the parent watches, replaces them and flies the rest.

Threads end here: the parent has a thread for each block in the air, each of which waits for a process of its own.
"""

import contextlib
import multiprocessing
import queue
import signal
import sys
import threading
import time
import types
from collections.abc import Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
from numpy.typing import NDArray

from abhv_mc.campaign.run.batches import Fly
from abhv_mc.campaign.run.retry import FlightLostError, UnusableError, fly_rescued, time_limit
from abhv_mc.campaign.run.worker import serve
from abhv_mc.flight.plan import FlightBlock, FlightPlan

Floats = NDArray[np.float64]

_PATIENCE = 20  # and one a worker, with starts that fail in a row: one refused or killed from outside counts 1
_OWN_END = 4  # and one that ended by itself this much
_PAUSE = 0.05  # s, before a start, for each of these
_COMPILING = 600.0  # s that a process may take to start and to load or compile a flight
_STARTING = 30.0  # s, at least, that one which has done so may take to say that it starts the next
_swap = threading.Lock()


class _EarlyEndError(Exception):
    """A worker's process did not start, or ended before it flew what it was sent: no flight's fault."""


def start_server(fly: Fly) -> None:
    """Start the process that workers are forked from, which imports in the background what ``fly`` needs."""
    from multiprocessing import forkserver

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([serve.__module__, fly.__module__, "llvmlite.binding"])
    with _deaf_to_interrupts():
        forkserver.ensure_running()


class _Worker:
    """One process and the pipe to it."""

    def __init__(self, fly: Fly) -> None:
        """Raises _EarlyEndError where the process could not be started."""
        context = multiprocessing.get_context("forkserver")
        self._connection, theirs = context.Pipe()
        self.process: BaseProcess = context.Process(target=serve, args=(theirs, fly), daemon=True)
        with theirs:
            try:
                with _without_main(), _deaf_to_interrupts():
                    self.process.start()
            except (OSError, EOFError) as error:  # the server is dying and not known to be dead, or cannot fork
                self._connection.close()
                raise _EarlyEndError(f"not started: {error or 'the server they are forked from ended'}") from None
        self.plans: set[int] = set()
        self.proven = False  # whether it has come to fly anything

    def fly(self, key: int, plan: FlightPlan, parameters: Floats, every: int | None, limit: float) -> FlightBlock:
        """Raises FlightLostError, and _EarlyEndError where the process ended before these flights started."""
        known = key in self.plans
        try:
            self._connection.send((key, None if known else plan, parameters, every))
            self.plans.add(key)
            answer = self._receive(max(limit, _STARTING) if known else _COMPILING)
        except (ConnectionError, FlightLostError):
            self.kill()
            raise _EarlyEndError(_describe_exit(self.process.exitcode)) from None
        self.proven = True
        if answer is None:
            answer = self._receive(limit)
        if isinstance(answer, str):
            raise FlightLostError(answer)
        return answer

    def _receive(self, limit: float) -> Any:
        connection: Connection = self._connection
        if not wait([connection], limit):
            self.kill()
            raise FlightLostError(f"not done in {limit:g} s")
        try:
            return connection.recv()
        except (EOFError, OSError):
            self.kill()
            raise FlightLostError(f"its process ended: {_describe_exit(self.process.exitcode)}") from None

    @property
    def alive(self) -> bool:
        return self.process.is_alive()

    def kill(self) -> None:
        """End the process, whatever it does."""
        self.process.kill()
        self.process.join()
        self._connection.close()


class Guard:
    """Flies in worker processes, each started when first needed; threads may call :meth:`fly` side by side."""

    def __init__(self, fly: Fly, workers: int, limit: float) -> None:
        """``limit`` is what one flight, or 16 abreast, may take, s."""
        self._fly, self._limit = fly, limit
        self._idle: queue.LifoQueue[_Worker | None] = queue.LifoQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._workers: set[_Worker] = set()
        self._plans: dict[int, tuple[int, FlightPlan]] = {}  # held, so that no id comes twice
        self._lock = threading.Lock()
        self._patience = _PATIENCE + workers
        self._failed_starts = 0  # weighed
        self._last_end = ""
        self._closed = False

    def fly(self, plan: FlightPlan, parameters: Floats, every: int | None = None) -> FlightBlock:
        """As the engine's ``fly``; what cannot be computed has the outcome ``failed_to_run``."""
        with self._lock:
            key, _ = self._plans.setdefault(id(plan), (len(self._plans), plan))
        return fly_rescued(lambda rows: self._attempt(key, plan, rows, every), plan, parameters, every)

    def _attempt(self, key: int, plan: FlightPlan, parameters: Floats, every: int | None) -> FlightBlock:
        worker = self._idle.get()
        try:
            while True:
                try:
                    worker = worker or self._start()
                    block = worker.fly(key, plan, parameters, every, time_limit(len(parameters), self._limit))
                except _EarlyEndError as end:
                    self._last_end = str(end)
                    if worker is None:
                        self._count_failed_start(1)
                    else:
                        self._discard(worker)
                    worker = None
                else:
                    self._failed_starts = 0
                    return block
        except FlightLostError:
            if worker is not None and not worker.alive:
                self._discard(worker)
                worker = None
            if self._closed:
                raise UnusableError("the campaign was stopped") from None
            raise
        finally:
            self._idle.put(worker)

    def _start(self) -> _Worker:
        if self._failed_starts >= self._patience:
            raise UnusableError(
                f"worker processes end before they fly ({self._last_end}); 'isolation: threads' does without them"
            )
        time.sleep(_PAUSE * self._failed_starts)
        if not self._closed:
            worker = _Worker(self._fly)
            with self._lock:
                self._workers.add(worker)
                closed = self._closed
            if not closed:
                return worker
            worker.kill()
        raise UnusableError("the campaign was stopped")

    def _discard(self, worker: _Worker) -> None:
        worker.kill()
        with self._lock:
            self._workers.discard(worker)
        if not worker.proven:
            self._count_failed_start(1 if worker.process.exitcode == -signal.SIGKILL else _OWN_END)

    def _count_failed_start(self, weight: int) -> None:
        with self._lock:
            self._failed_starts += weight

    def close(self) -> None:
        """End every worker at once; flights in the air are lost."""
        with self._lock:
            self._closed = True
            workers = list(self._workers)
        for worker in workers:
            with contextlib.suppress(OSError, ValueError):
                worker.process.kill()


@contextlib.contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start processes that no Ctrl-C reaches, which goes to everyone in the terminal: the parent decides."""
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # which lets signals in again when it starts
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _without_main() -> Iterator[None]:
    """Start a process that does not run the caller's script again, as multiprocessing otherwise would."""
    with _swap:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = types.ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


def _describe_exit(code: int | None) -> str:
    if code is not None and code < 0:
        return f"killed by {signal.Signals(-code).name}"
    return f"exit code {code}"
