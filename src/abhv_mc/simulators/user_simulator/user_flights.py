"""Flights of a user's simulator: a crash or a hang costs the flight that was under way, and none is flown twice."""

import atexit
import os
import sys
import threading
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.simulators.user_simulator.answers import find_extremes, read_answer, sample_histories
from abhv_mc.simulators.user_simulator.process import LostFlightError, Process
from abhv_mc.simulators.user_simulator.user_plan import UserPlan

_seconds: dict[object, float] = {}  # mean time of a flight of the last block, by process and system
_told: set[str] = set()  # reasons that were said already


class StoppedError(Exception):
    """The campaign was stopped while a flight was under way."""


class _Pool:
    """Processes of this one that fly; threads share it."""

    def __init__(self) -> None:
        self.idle: dict[object, list[Process]] = {}
        self.all: set[Process] = set()
        self.lock = threading.Lock()
        self.closed = False
        self.owner = os.getpid()

    def take(self, plan: UserPlan) -> Process:
        """A process that waits for flights, or a new one."""
        with self.lock:
            if idle := self.idle.get(plan.process):
                return idle.pop()
        plan.check_files()
        process = Process(plan)
        with self.lock:
            self.all.add(process)
        if self.closed:
            process.end()
        return process

    def give_back(self, plan: UserPlan, process: Process) -> None:
        if not process.is_silent:
            process.end()
            _tell(plan, "it writes more lines than answers; it is started anew after each block")
            return
        with self.lock:
            self.idle.setdefault(plan.process, []).append(process)

    def close(self) -> None:
        """End all of them; flights under way are lost."""
        self.closed = True
        if self.owner == os.getpid():
            for process in list(self.all):
                process.end()


_pool = _Pool()


def end_processes() -> None:
    """End every process that waits or flies; flights that come later have new ones."""
    global _pool
    ended, _pool = _pool, _Pool()
    ended.close()


atexit.register(end_processes)


def seconds_of_a_flight(plans: Iterable[Any]) -> float:
    """Mean time of the flights flown last, of the slowest of some systems, s; 0 before any."""
    return max(_seconds.get((plan.process, plan.controller), 0.0) for plan in plans)


def fly_user_simulator(plan: UserPlan, parameters: Floats, recorded: Recording | int | None = None) -> FlightBlock:
    """Fly ``parameters`` [flight, input], in the inputs' own units; ``failed_to_run`` for what cannot be computed.

    ``recorded``: a Recording for bands over time, or so many times as far apart as histories are kept.
    """
    for_bands = isinstance(recorded, Recording)
    rate = plan.band_rate if isinstance(recorded, Recording) else plan.rate / (recorded or 1)
    flights, histories = len(parameters), dict[int, Floats]()
    metrics, end = np.full((flights, len(plan.metrics)), np.nan), np.full(flights, np.nan)
    outcome = np.full(flights, int(Outcome.FAILED_TO_RUN), np.int64)
    pool, lines, done = _pool, plan.lines(parameters), 0
    process: Process | None = None
    begun = time.monotonic()
    while done < flights:
        try:
            process = process or pool.take(plan)
            for found in process.answers(lines[done:], plan.time_limit):
                try:
                    outcome[done], end[done], metrics[done], history = read_answer(found, plan)
                    if recorded and history is not None:
                        histories[done] = history
                except ValueError as error:
                    if plan.command and "error" not in found:
                        raise LostFlightError(str(error)) from None  # what follows may be of any flight
                    _tell(plan, str(error))
                done += 1
        except (LostFlightError, OSError) as lost:
            if process is not None:
                process.end()
            process = None
            if pool.closed:
                raise StoppedError("the campaign was stopped") from None
            _tell(plan, str(lost))
            done += 1
    if process is not None:
        pool.give_back(plan, process)
    if flights:
        _seconds[plan.process, plan.controller] = (time.monotonic() - begun) / flights
    times, sampled = sample_histories(histories, flights, len(plan.channels), rate, int(for_bands))
    low, high = find_extremes(histories, times, sampled) if for_bands else (None, None)
    return FlightBlock(outcome, end, metrics, sampled, times, low=low, high=high)


def _tell(plan: UserPlan, reason: str) -> None:
    which = "a first flight, flown for a check and none of the campaign's," if plan.check else "a flight"
    if (words := f"{plan.controller}: {which} could not be computed: {reason}") not in _told:
        _told.add(words)
        print(words, file=sys.stderr, flush=True)
