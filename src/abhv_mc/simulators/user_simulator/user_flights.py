"""Flights of a user's simulator: a crash or a hang costs the flight that was under way, and none is flown twice.

What it answers is read, and its histories are sampled at common times.
"""

import atexit
import math
import os
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.simulators.user_simulator.process import LostFlightError, Process
from abhv_mc.simulators.user_simulator.user_plan import UserPlan

_NEAR = 1e-6  # of the time between samples of a history: those that end so near to one have it
_seconds: dict[object, float] = {}  # mean time of a flight of the last block, by system
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


def process_ids() -> list[int]:
    """Return the numbers of the processes that wait or simulate."""
    return [process.number for process in list(_pool.all) if process.number]


def seconds_of_a_flight(plans: Iterable[Any]) -> float:
    """Mean time of the flights flown last, of the slowest of some systems, s; 0 before any."""
    return max(_seconds.get(plan.system, 0.0) for plan in plans)


def fly_user_simulator(
    plan: UserPlan, parameters: Floats, recorded: Recording | int | None = None
) -> FlightBlock:
    """Fly ``parameters`` [flight, input], in the inputs' own units; ``failed_to_run`` for what cannot be computed.

    ``recorded``: a Recording for bands over time, or so many times as far apart as histories are kept.
    """
    for_bands = isinstance(recorded, Recording)
    rate = plan.band_rate if isinstance(recorded, Recording) else plan.rate / (recorded or 1)
    flights, histories = len(parameters), dict[int, Floats]()
    metrics, end = np.full((flights, len(plan.metrics)), np.nan), np.full(flights, np.nan)
    outcome = np.full(flights, int(Outcome.FAILED_TO_RUN), np.int64)
    pool, lines, done = _pool, plan.lines(parameters), 0
    reasons, events = dict[int, str](), Counter[str]()
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
                        raise LostFlightError(
                            str(error)
                        ) from None  # what follows may be of any flight
                    reasons[done] = str(error)
                    _tell(plan, str(error))
                done += 1
        except (LostFlightError, OSError) as lost:
            if process is not None:
                process.end()
                events["restarts"] += 1
            process = None
            if pool.closed:
                raise StoppedError("the campaign was stopped") from None
            reasons[done] = str(lost)
            _tell(plan, str(lost))
            done += 1
    if process is not None:
        pool.give_back(plan, process)
    if flights:
        _seconds[plan.system] = (time.monotonic() - begun) / flights
    times, sampled = sample_histories(histories, flights, len(plan.channels), rate, int(for_bands))
    low, high = find_extremes(histories, times, sampled) if for_bands else (None, None)
    return FlightBlock(
        outcome,
        end,
        metrics,
        sampled,
        times,
        low=low,
        high=high,
        reasons=reasons,
        events=events,
    )


def _tell(plan: UserPlan, reason: str) -> None:
    which = (
        "a first flight, flown for a check and none of the campaign's,"
        if plan.check
        else "a flight"
    )
    if (words := f"{plan.controller}: {which} could not be computed: {reason}") not in _told:
        _told.add(words)
        print(words, file=sys.stderr, flush=True)


class Answer(NamedTuple):
    """A flight that was computed."""

    outcome: int
    end_time: float
    metrics: list[float]
    history: (
        Floats | None
    )  # [column, sample]: its time, then the channels; None where none is declared


def read_answer(found: dict[str, Any], plan: UserPlan) -> Answer:
    """Raises ValueError where it is not what the campaign declares."""
    if "error" in found:
        raise ValueError(str(found["error"]))
    code = found.get("outcome", "ok")
    if not isinstance(code, str) or code not in plan.outcomes:
        raise ValueError(f"it returned the outcome '{code}', which the campaign does not declare")
    held = found.keys() - {"outcome", "end_time"}
    if held != plan.expected:
        for name in sorted(held - plan.expected):
            raise ValueError(f"it returned '{name}', which the campaign does not declare")
        raise ValueError(f"it did not return {', '.join(sorted(plan.expected - held))}")
    try:
        values = [
            math.nan if found[metric.name] is None else float(found[metric.name])
            for metric in plan.metrics
        ]
        end = float(found.get("end_time", math.nan))
    except (TypeError, ValueError, OverflowError):
        raise ValueError("it returned a metric or an end_time that is no number") from None
    ok = code == "ok"
    if ok and not all(map(math.isfinite, values)):
        name = next(
            each.name
            for each, value in zip(plan.metrics, values, strict=True)
            if not math.isfinite(value)
        )
        raise ValueError(f"{name} is not a finite number, and the outcome is ok")
    history = _read_history(found["history"], plan, ok) if plan.channels else None
    return Answer(plan.outcomes[code], end if ok or math.isfinite(end) else 0.0, values, history)


def _read_history(given: Any, plan: UserPlan, ok: bool) -> Floats:
    """Time and channels [column, sample] of a flight. Raises ValueError where they are none."""
    columns = ["time", *(channel.name for channel in plan.channels)]
    if not isinstance(given, dict) or given.keys() != set(columns):
        held = ", ".join(given) if isinstance(given, dict) else f"{given!r:.80}"
        raise ValueError(
            f"its history holds {held or 'nothing'}; declared are {', '.join(columns)}"
        )
    try:
        history = np.array([given[name] for name in columns], np.float64)
    except (TypeError, ValueError, OverflowError):
        history = np.empty(0)
    if history.ndim != 2 or not history.size:
        raise ValueError("the columns of its history are no lists of numbers of one length")
    if not np.isfinite(history[0]).all() or (np.diff(history[0]) < 0.0).any():
        raise ValueError("the time of its history does not ascend")
    if ok and not np.isfinite(history).all():
        name = columns[int(np.argmin(np.isfinite(history).all(axis=1)))]
        raise ValueError(f"{name} of its history is not a finite number, and the outcome is ok")
    return history


def sample_histories(
    histories: Mapping[int, Floats], flights: int, channels: int, rate: float, beyond: int = 0
) -> tuple[Floats, Singles]:
    """Times [time] s, ``rate`` of them a second, and the histories there [flight, time, channel]: linear between what
    was returned, NaN before and after it. The times reach so many ``beyond`` the flights on either side."""
    spans = {
        flight: (math.ceil(clock[0] * rate - _NEAR), math.floor(clock[-1] * rate + _NEAR) + 1)
        for flight, (clock, *_) in histories.items()
    }
    first = min((start for start, _ in spans.values()), default=0) - beyond
    times = (
        np.arange(first, max((stop for _, stop in spans.values()), default=first - beyond) + beyond)
        / rate
    )
    sampled = np.full((flights, times.size, channels), np.nan, np.float32)
    for flight, (clock, *columns) in histories.items():
        own = slice(*(place - first for place in spans[flight]))
        for i, column in enumerate(columns):
            sampled[flight, own, i] = np.interp(times[own], clock, column)
    return times, sampled


def find_extremes(
    histories: Mapping[int, Floats], times: Floats, sampled: Singles
) -> tuple[Singles, Singles]:
    """Least and greatest values [time, channel] of all flights from the time before to the time after: of what was
    returned, and of the line between. ``times`` reach beyond all flights."""
    placed = [
        (np.unique(np.searchsorted(times, each[0]), return_index=True), each[1:])
        for each in histories.values()
    ]
    ends = []
    for extreme in (np.fmin, np.fmax):
        at = np.full((times.size + 2, sampled.shape[2]), np.nan, np.float32)
        at[1:-1] = extreme.reduce(sampled, axis=0)
        between = np.full(
            (times.size + 1, sampled.shape[2]), np.nan, np.float32
        )  # of samples up to each time
        for (place, first), columns in placed:
            between[place] = extreme(between[place], extreme.reduceat(columns, first, axis=1).T)
        ends.append(extreme.reduce([at[:-2], at[1:-1], at[2:], between[:-1], between[1:]]))
    return ends[0], ends[1]
