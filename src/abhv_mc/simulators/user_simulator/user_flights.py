"""Flights of a user's simulator: a crash or a hang costs the flight that was under way, and none is flown twice."""

import atexit
import json
import math
import os
import sys
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.simulators.user_simulator.process import LostFlightError, Process
from abhv_mc.simulators.user_simulator.user_plan import UserPlan

_SPECIAL = {"outcome", "end_time"}
_NEAR = 1e-6  # of the time between samples of a history: those that end so near to one have it
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

    ``recorded``: whether histories are, and so many times as far apart as the campaign's rate says.
    """
    every = recorded.every if isinstance(recorded, Recording) else recorded or 0
    columns = ["time", *(channel.name for channel in plan.channels)] if plan.channels else []
    histories: dict[int, Floats] = {}
    flights = len(parameters)
    metrics, end = np.full((flights, len(plan.metrics)), np.nan), np.full(flights, np.nan)
    outcome = np.full(flights, int(Outcome.FAILED_TO_RUN), np.int64)
    pool, lines, done = _pool, plan.lines(parameters), 0
    names, codes = [metric.name for metric in plan.metrics], dict(plan.outcomes)
    expected = {*names, "history"} if columns else set(names)
    process: Process | None = None
    begun = time.monotonic()
    while done < flights:
        reason = ""
        try:
            process = process or pool.take(plan)
            for answer in process.answers(lines[done:], flights - done, plan.time_limit):
                try:
                    found, code = _read(answer, expected, codes)
                    history = _read_history(found["history"], columns, code == "ok") if columns else None
                    end[done], metrics[done] = _read_numbers(found, names, code == "ok")
                    outcome[done] = codes[code]
                    if every and history is not None:
                        histories[done] = history
                except ValueError as error:
                    _tell(plan, str(error))
                done += 1
        except (LostFlightError, OSError) as lost:
            process, reason = None, str(lost)
        if pool.closed:
            raise StoppedError("the campaign was stopped")
        if reason and done < flights:
            _tell(plan, reason)
            done += 1
    if process is not None:
        pool.give_back(plan, process)
    if flights:
        _seconds[plan.process, plan.controller] = (time.monotonic() - begun) / flights
    times, sampled = _sample(histories, flights, len(plan.channels), plan.rate / (every or 1))
    return FlightBlock(outcome, end, metrics, sampled, times)


def _sample(histories: Mapping[int, Floats], flights: int, channels: int, rate: float) -> tuple[Floats, Singles]:
    """Times [time] s, ``rate`` of them a second, and the histories there [flight, time, channel]: linear between what
    was returned, NaN before and after it."""
    spans = {
        flight: (math.ceil(clock[0] * rate - _NEAR), math.floor(clock[-1] * rate + _NEAR) + 1)
        for flight, (clock, *_) in histories.items()
    }
    first = min((start for start, _ in spans.values()), default=0)
    times = np.arange(first, max((stop for _, stop in spans.values()), default=0)) / rate
    sampled = np.full((flights, times.size, channels), np.nan, np.float32)
    for flight, (clock, *columns) in histories.items():
        own = slice(*(place - first for place in spans[flight]))
        for i, column in enumerate(columns):
            sampled[flight, own, i] = np.interp(times[own], clock, column)
    return times, sampled


def _read(answer: bytes, expected: set[str], codes: Mapping[str, int]) -> tuple[dict[str, Any], str]:
    """An answer and the code of its outcome. Raises ValueError where it is none, or what it holds is not expected."""
    try:
        found: dict[str, Any] = json.loads(answer)
    except ValueError:
        raise ValueError(f"it answered {answer[:80]!r}, which is no JSON") from None
    if not isinstance(found, dict):
        raise ValueError(f"it answered {answer[:80]!r}, which is no mapping")
    if "error" in found:
        raise ValueError(str(found["error"]))
    code = found.get("outcome", "ok")
    if code not in codes:
        raise ValueError(f"it returned the outcome '{code}', which the campaign does not declare")
    if found.keys() - _SPECIAL != expected:
        for name in sorted(found.keys() - _SPECIAL - expected):
            raise ValueError(f"it returned '{name}', which the campaign does not declare")
        missing = ", ".join(sorted(expected - found.keys()))
        raise ValueError(f"it did not return {missing}")
    return found, code


def _read_history(given: Any, columns: Sequence[str], ok: bool) -> Floats:
    """Time and channels [column, sample] of a flight. Raises ValueError where they are none."""
    if not isinstance(given, dict) or given.keys() != set(columns):
        held = ", ".join(given) if isinstance(given, dict) else f"{given!r:.80}"
        raise ValueError(f"its history holds {held or 'nothing'}; declared are {', '.join(columns)}")
    try:
        history = np.array([given[name] for name in columns], np.float64)
    except (TypeError, ValueError):
        history = np.empty(0)
    if history.ndim != 2 or not history.size:
        raise ValueError("the columns of its history are no lists of numbers of one length")
    if not np.isfinite(history[0]).all() or (np.diff(history[0]) < 0.0).any():
        raise ValueError("the time of its history does not ascend")
    if ok and not np.isfinite(history).all():
        name = columns[int(np.argmin(np.isfinite(history).all(axis=1)))]
        raise ValueError(f"{name} of its history is not a finite number, and the outcome is ok")
    return history


def _read_numbers(found: Mapping[str, Any], names: Sequence[str], ok: bool) -> tuple[float, list[float]]:
    """End and metrics of an answer. Raises ValueError where they are none."""
    try:
        values = [math.nan if found[name] is None else float(found[name]) for name in names]
        end = float(found.get("end_time", math.nan))
    except (TypeError, ValueError):
        raise ValueError("it returned a metric or an end_time that is no number") from None
    if ok and not all(map(math.isfinite, values)):
        name = next(name for name, value in zip(names, values, strict=True) if not math.isfinite(value))
        raise ValueError(f"{name} is not a finite number, and the outcome is ok")
    return end if ok or math.isfinite(end) else 0.0, values


def _tell(plan: UserPlan, reason: str) -> None:
    which = "a first flight, flown for a check and none of the campaign's," if plan.check else "a flight"
    if (words := f"{plan.controller}: {which} could not be computed: {reason}") not in _told:
        _told.add(words)
        print(words, file=sys.stderr, flush=True)
