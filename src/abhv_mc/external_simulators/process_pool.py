"""Pool of idle and busy simulator processes that threads share."""

import atexit
import os
import threading

from abhv_mc.external_simulators.process import Process
from abhv_mc.external_simulators.user_plan import UserPlan


class StoppedError(Exception):
    """Error raised if the campaign is stopped during a flight."""


class ProcessPool:
    """Thread-safe pool of simulator processes."""

    def __init__(self) -> None:
        self.idle: dict[object, list[Process]] = {}
        self.all: set[Process] = set()
        self.lock = threading.Lock()
        self.closed = False
        self.owner = os.getpid()

    def take(self, plan: UserPlan) -> Process:
        """Return an idle process or a new process for a plan."""
        with self.lock:
            if idle := self.idle.get(plan.process):
                return idle.pop()
        process = Process(plan)
        with self.lock:
            self.all.add(process)
        if self.closed:
            process.end()
        return process

    def give_back(self, plan: UserPlan, process: Process) -> None:
        """Return an idle process to the pool for later flights."""
        with self.lock:
            self.idle.setdefault(plan.process, []).append(process)

    def end(self, process: Process) -> None:
        """End a process and remove it from the pool."""
        process.end()
        with self.lock:
            self.all.discard(process)

    def close(self) -> None:
        """End all processes; their current flights fail."""
        self.closed = True
        if self.owner == os.getpid():
            for process in list(self.all):
                process.end()


_pool = ProcessPool()


def current_pool() -> ProcessPool:
    """Return the process pool for new flights."""
    return _pool


def end_processes() -> None:
    """End all idle and busy processes; later flights start new processes."""
    global _pool
    ended, _pool = _pool, ProcessPool()
    ended.close()


atexit.register(end_processes)
