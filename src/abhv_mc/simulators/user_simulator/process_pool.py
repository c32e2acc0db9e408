"""Idle and busy processes of user simulators; threads share them."""

import atexit
import os
import threading

from abhv_mc.simulators.user_simulator.process import Process
from abhv_mc.simulators.user_simulator.user_plan import UserPlan


class StoppedError(Exception):
    """The campaign was stopped while a flight was under way."""


class ProcessPool:
    """Processes of this one that run flights; threads share it."""

    def __init__(self) -> None:
        self.idle: dict[object, list[Process]] = {}
        self.all: set[Process] = set()
        self.lock = threading.Lock()
        self.closed = False
        self.owner = os.getpid()

    def take(self, plan: UserPlan) -> Process:
        """Return a process that waits for flights, or a new one."""
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
        """Keep a process for later flights."""
        with self.lock:
            self.idle.setdefault(plan.process, []).append(process)

    def end(self, process: Process) -> None:
        """End a process for good."""
        process.end()
        with self.lock:
            self.all.discard(process)

    def close(self) -> None:
        """End all of them; flights under way are lost."""
        self.closed = True
        if self.owner == os.getpid():
            for process in list(self.all):
                process.end()


_pool = ProcessPool()


def current_pool() -> ProcessPool:
    """Return the pool that new flights use."""
    return _pool


def end_processes() -> None:
    """End every process that waits or flies; flights that come later have new ones."""
    global _pool
    ended, _pool = _pool, ProcessPool()
    ended.close()


atexit.register(end_processes)
