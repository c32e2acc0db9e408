"""Pool of worker processes, which starts a new process for each one that hangs or ends.

For each process, a thread of the parent waits for results. Each process has a separate pipe, so a
process that is killed while it sends a result does not disturb the other processes.
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
from collections.abc import Callable, Iterator
from multiprocessing import forkserver, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any

from abhv_mc.array_types import Floats
from abhv_mc.custom_code.child import describe_exit
from abhv_mc.execution.retry import FlightLostError, UnusableError
from abhv_mc.execution.worker import serve, usual_limit
from abhv_mc.flights.blocks import FlightBlock
from abhv_mc.interfaces import Fly, Recorded

# Give up after 20 + workers consecutive failed starts; a crash counts as four failed starts.
_FAILED_STARTS = 20
_CRASH = 4
_PAUSE = 0.05  # pause in s before a start, multiplied by the number of failed starts
_COMPILE_LIMIT = 600.0  # time in s to start a process and load or compile a flight
_RESPONSE_LIMIT = 60.0  # time in s for a ready process to begin the next block
# Limit on wall time: the larger of 600 s and 20 times the limit on processor time.
_ASLEEP, _WALL = 600.0, 20.0
_start_lock = threading.Lock()


class _NotBegunError(Exception):
    """Error raised if a worker process did not start, or ended before its flights began."""


def start_fork_server(fly: Fly) -> None:
    """Start the fork server of the workers, which imports the modules of ``fly``.

    If the fork server cannot be started, the first worker reports the reason.
    """
    context = multiprocessing.get_context("forkserver")
    # numba imports numpy.ma when it first calls a kernel.
    modules = [serve.__module__, fly.__module__, "numba", "numpy.ma"]
    context.set_forkserver_preload(modules)
    with contextlib.suppress(OSError), _starting_processes():
        forkserver.ensure_running()


class _Worker:
    """Worker process with its pipe.

    The constructor raises OSError or EOFError if the process cannot be started.
    """

    def __init__(self, fly: Fly, describe_crash: Callable[[int | None], str]) -> None:
        self._describe_crash = describe_crash
        context = multiprocessing.get_context("forkserver")
        self._connection, worker_end = context.Pipe()
        with worker_end:
            try:
                with _starting_processes():
                    self.process: BaseProcess = context.Process(
                        target=serve, args=(worker_end, fly), daemon=True
                    )
                    self.process.start()
            except (OSError, EOFError):
                self._connection.close()
                raise
        self._plans: set[int] = set()  # keys of the plans sent to the process
        self.has_flown = False

    def fly(
        self,
        key: int,
        plan: Any,
        parameters: Floats,
        recorded: Recorded,
        limit: float | None,
    ) -> FlightBlock:
        """Compute a block. Raise FlightLostError if flights are lost.

        Raise _NotBegunError if the process ended before the flights began.
        """
        has_plan = key in self._plans
        try:
            self._connection.send((key, None if has_plan else plan, parameters, recorded, limit))
            self._plans.add(key)
            answer = self._receive(_RESPONSE_LIMIT if has_plan else _COMPILE_LIMIT)
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
        """Return the next message. Raise FlightLostError if the process is too slow or ends."""
        connection: Connection = self._connection
        if not wait([connection], limit):
            self.kill()
            problem = f"not finished within {limit:g} s{self._describe_crash(self.process.pid)}"
            raise FlightLostError(problem, process=True, hung=True)
        try:
            return connection.recv()
        except (EOFError, OSError):
            self.kill()
            code = self.process.exitcode
            hung = code == -signal.SIGPROF
            problem = (
                f"not finished within {processor:g} s"
                if hung
                else f"its process ended: {describe_exit(code)}"
            )
            raise FlightLostError(
                problem + self._describe_crash(self.process.pid), process=True, hung=hung
            ) from None

    def kill(self) -> None:
        """Kill the process and close its pipe."""
        self.process.kill()
        self.process.join()
        self._connection.close()


class WorkerPool:
    """Pool of worker processes, which start when first needed; :meth:`fly` is thread-safe."""

    def __init__(
        self,
        fly: Fly,
        workers: int,
        limit: float | None,
        describe_crash: Callable[[int | None], str],
    ) -> None:
        """Prepare the pool; ``limit`` is the limit on processor time (s) for 16 flights."""
        self._describe_crash = describe_crash
        self._fly, self.workers, self._limit = fly, workers, limit
        self._idle: queue.LifoQueue[_Worker | None] = queue.LifoQueue()
        for _ in range(workers):
            self._idle.put(None)
        self._workers: set[_Worker] = set()
        # Key and plan by id of the plan; the stored reference keeps the id unique.
        self._plans: dict[int, tuple[int, Any]] = {}
        self._limits: dict[int, float | None] = {}  # time limits in s by key of the plan
        self._lock, self._limiting = threading.Lock(), threading.Lock()
        self._most_failed_starts = _FAILED_STARTS + workers
        self._failed_starts = 0  # weighted number of consecutive failed starts
        self._last_end = ""
        self._closed = False

    def fly(self, plan: Any, parameters: Floats, recorded: Recorded = None) -> FlightBlock:
        """Compute a block in a worker process. Raise FlightLostError or UnusableError."""
        with self._lock:
            key, _ = self._plans.setdefault(id(plan), (len(self._plans), plan))

        with self._limiting:
            if key not in self._limits:
                self._limits[key] = self._limit or self._find_limit(plan)
        return self._attempt(key, plan, parameters, recorded)

    def _find_limit(self, plan: Any) -> float | None:
        """Derive the time limit for all workers from a nominal flight in this process.

        Return None if the flight must not run in this process; each worker then derives its own
        limit.
        """
        if plan.must_run_in_child:
            return None
        try:
            return usual_limit(self._fly, plan, time.thread_time)
        except Exception:  # A worker will report the error.
            return None

    def _attempt(self, key: int, plan: Any, parameters: Floats, recorded: Recorded) -> FlightBlock:
        worker = self._idle.get()
        try:
            while True:
                worker = worker or self._start()
                try:
                    block = worker.fly(key, plan, parameters, recorded, self._limits[key])
                except _NotBegunError as error:
                    self._remove(worker, str(error))
                    worker = None
                else:
                    self._failed_starts = 0
                    return block
        except FlightLostError as error:
            if worker is not None and not worker.process.is_alive():
                self._remove(worker, str(error))
                worker = None
            if self._closed:
                raise UnusableError("the campaign was stopped") from None
            raise
        finally:
            self._idle.put(worker)

    def _start(self) -> _Worker:
        while not self._closed:
            if self._failed_starts >= self._most_failed_starts:
                raise UnusableError(
                    f"worker processes end before their first flight ({self._last_end});"
                    " the setting 'isolation: threads' runs flights without worker processes"
                )
            time.sleep(_PAUSE * self._failed_starts)
            try:
                worker = _Worker(self._fly, self._describe_crash)
            except (OSError, EOFError) as error:  # The fork server is ending or cannot fork.
                self._count_failed_start(1, f"not started: {error or 'the fork server ended'}")
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
        """Kill all workers; flights in progress are lost."""
        with self._lock:
            self._closed = True
            workers = list(self._workers)
        for worker in workers:
            with contextlib.suppress(OSError, ValueError):
                worker.process.kill()


@contextlib.contextmanager
def _starting_processes() -> Iterator[None]:
    """Make new multiprocessing workers ignore Ctrl-C and use the parent's sys.path.

    Ctrl-C reaches all processes of the terminal, and the parent handles the interrupt. The workers
    do not run the script of the caller again. The fork server and its helper are started with
    ``python -c``, which would import modules from the working directory first; environment
    variables prevent such imports.
    """
    import_path = os.pathsep.join(map(os.path.abspath, sys.path))
    with _start_lock:
        main, before = sys.modules["__main__"], dict(os.environ)
        # Additional threads would waste time on small matrices.
        threads = before.get("OPENBLAS_NUM_THREADS", "1")
        changed = {
            "PYTHONPATH": import_path,
            "PYTHONSAFEPATH": "1",
            "OPENBLAS_NUM_THREADS": threads,
        }
        os.environ.update(changed)
        resource_tracker.ensure_running()  # The resource tracker unblocks signals when it starts.
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
