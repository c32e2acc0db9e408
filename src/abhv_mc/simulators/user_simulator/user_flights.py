"""Flights of a user's simulator: a crash or a hang costs the flight that was under way, and none is flown twice.

What it answers is read, and its histories are sampled at common times.
"""

import atexit
import json
import math
import os
import sys
import threading
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.campaign.file.experiment import Experiment
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.plan import FlightBlock, Recording
from abhv_mc.simulators.user_simulator.process import LostFlightError, OutOfStepError, Process
from abhv_mc.simulators.user_simulator.user_plan import UserPlan

_NEAR = 1e-6  # of the time between samples of a history: those that end so near to one have it
_AHEAD = 1e-3  # s: shorter flights are requested ahead of their answers
_SLACK = 0.02  # s that a proof of silence takes beyond twice the longest answer
_SHORT_PROOF = 0.25  # s that it may take after fewer flights than
_PROOF = 20  # flights of a process
_RARE = 300  # so many pieces of the usual flights between two surplus lines are proven one by one
_START_TIMES, _START_SLACK = 10.0, 10.0  # times the first answer before, and s, that a start takes
_LARGEST = 1 << 1023  # whole number below which each has a floating-point one
Key = tuple[object, str]  # process and system


class _Record:
    """Times and surplus output of one system's flights in this process so far."""

    def __init__(self) -> None:
        self.seconds = 0.0  # mean of a flight of the last block
        self.longest = 0.0  # s of an answer, but of a process's first
        self.start: float | None = None  # s, the longest first answer
        self.flights = self.surplus = 0


_records: dict[Key, _Record] = defaultdict(_Record)
_told: set[str] = set()  # reasons that were said already


class StoppedError(Exception):
    """The campaign was stopped while a flight was under way."""


class _Pool:
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
        with self.lock:
            self.idle.setdefault(plan.process, []).append(process)

    def end(self, process: Process) -> None:
        process.end()
        with self.lock:
            self.all.discard(process)

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
    return max(_records[plan.process, plan.controller].seconds for plan in plans)


def note_surplus(plan: UserPlan, flights: int, surplus: int) -> None:
    """Count flights of a system, and lines beyond their answers, that other machines saw."""
    record = _records[plan.process, plan.controller]
    record.flights += flights
    record.surplus += surplus


def prove_blocks(campaign: Experiment) -> Experiment:
    """Return the campaign with a proof of silence after each block of a user's program."""
    systems = {
        name: system._replace(plan=replace(cast("Any", system.plan), is_proven=True))
        if isinstance(system.plan, UserPlan)
        else system
        for name, system in campaign.systems.items()
    }
    return replace(campaign, systems=systems)


def describe_events(system: str, events: Mapping[str, int]) -> list[str]:
    """Return warnings about the events of a system's flights (:attr:`FlightBlock.events`)."""
    if not events.get("surplus"):
        return []
    return [
        f"'{system}' wrote lines that answer no request. Flights whose answers could belong to"
        " others were computed again one by one; a flight that answered twice failed to run"
    ]


def with_surplus(plan: UserPlan) -> UserPlan:
    """Return the plan with what this process knows of its surplus output, for another one."""
    record = _records[plan.process, plan.controller]
    return replace(plan, seen=(record.flights, record.surplus))


def fly_user_simulator(
    plan: UserPlan, parameters: Floats, recorded: Recording | int | None = None
) -> FlightBlock:
    """Fly ``parameters`` [flight, input], in the inputs' own units; ``failed_to_run`` for what cannot be computed.

    ``recorded``: a Recording for bands over time, or so many times as far apart as histories are kept.
    """
    for_bands = isinstance(recorded, Recording)
    rate = plan.band_rate if isinstance(recorded, Recording) else plan.rate / (recorded or 1)
    flights = _Flights(plan, parameters, bool(recorded))
    flights.run()
    histories, number = flights.histories, len(parameters)
    times, sampled = sample_histories(histories, number, len(plan.channels), rate, int(for_bands))
    low, high = find_extremes(histories, times, sampled) if for_bands else (None, None)
    return FlightBlock(
        outcome=flights.outcome,
        end_time=flights.end_time,
        metrics=flights.metrics,
        history=sampled,
        times=times,
        low=low,
        high=high,
        events=dict(flights.events),
        standard_error="".join(flights.errors),
    )


class _Flights:
    """The flights of one call and their results.

    A program that does not repeat the text of a request answers in order: one line too many gives
    every later flight the numbers of another. The surplus shows only when the process is idle, so
    flights are accepted when it was silent after them, and else computed again.
    """

    def __init__(self, plan: UserPlan, parameters: Floats, with_histories: bool) -> None:
        self.plan, self.with_histories = plan, with_histories
        self.requests = plan.requests(parameters)
        number = len(parameters)
        self.metrics = np.full((number, len(plan.metrics)), np.nan)
        self.end_time = np.full(number, np.nan)
        self.outcome = np.full(number, int(Outcome.FAILED_TO_RUN), np.int64)
        self.histories: dict[int, Floats] = {}
        self.events: Counter[str] = Counter()
        self.errors: list[str] = []
        self.pool = _pool
        self.record = _records[plan.process, plan.controller]
        flights, surplus = plan.seen
        self.record.flights = max(self.record.flights, flights)
        self.record.surplus = max(self.record.surplus, surplus)
        self.waited = 0.0  # s for processes to start, and to be proven silent
        self.is_ahead = 0.0 < self.record.seconds < _AHEAD

    def run(self) -> None:
        """Compute all of them."""
        number, begun = len(self.requests), time.monotonic()
        self._run_pieces(0, number)
        self.record.flights += number
        if number:
            self.record.seconds = max(0.0, time.monotonic() - begun - self.waited) / number

    def _run_pieces(self, first: int, stop: int, largest: int | None = None) -> None:
        """Compute flights in pieces that are each proven, the smaller the more surplus was seen."""
        while first < stop:
            size = largest or stop - first
            if self.record.surplus:
                size = min(size, self.record.flights // (_RARE * self.record.surplus))
            size = max(1, min(size, stop - first))
            if size == 1 and self.record.surplus:
                self._run_alone(first)
            else:
                self._run_piece(first, first + size)
            first += size

    def _run_piece(self, first: int, stop: int) -> None:
        """Compute flights that follow each other without a pause."""
        plan, done = self.plan, first
        while done < stop:
            begun, process = done, None
            try:
                process = self._take()
                most = plan.flights_per_process
                room = most - process.flights if most else stop
                requests = self.requests[done : min(stop, done + room)]
                is_new = not process.flights
                for answer in process.answers(
                    requests, plan.time_limit, start=self._start(), ahead=self.is_ahead
                ):
                    self._keep(done, answer)
                    done += 1
                if is_new and len(requests) > 1:
                    self.waited += max(0.0, process.first_time - process.longest)
                self._prove(process)
                self._leave(process)
            except OutOfStepError:
                self._end(process)
                self._note_surplus()
                stop_again = max(done, begun + 1)
                self.events["repeated"] += stop_again - begun
                self._run_pieces(begun, stop_again, max(1, (stop_again - begun) // 2))
                done = stop_again
            except (LostFlightError, OSError) as lost:
                unproven = process.unproven if process else 0
                self._end(process)
                if not unproven:
                    self._lose(done, str(lost))
                elif self._run_alone(done) and done > begun:  # it was not this flight's fault
                    self.record.surplus += 1
                    self.events["repeated"] += done - begun
                    for flight in range(begun, done):
                        self._run_alone(flight)
                done += 1

    def _run_alone(self, flight: int) -> bool:
        """Compute a flight in a process that is silent before and after it; return whether it is."""
        plan, process = self.plan, None
        try:
            process = self._take(is_proven=True)
            for answer in process.answers(
                self.requests[flight : flight + 1], plan.time_limit, start=self._start()
            ):
                self._keep(flight, answer)
            is_last = process.flights == plan.flights_per_process
            self._wait_for_silence(process, self._full_proof(process), is_last)
            process.unproven = 0
            self._leave(process)
        except OutOfStepError:
            self._end(process)
            self._note_surplus()
            self._lose(flight, "it answered twice")
            return False
        except (LostFlightError, OSError) as lost:
            self._end(process)
            self._lose(flight, str(lost))
            return False
        return True

    def _take(self, is_proven: bool = False) -> Process:
        """Return an idle process that has written nothing since its last answer, or a new one."""
        while True:
            begun = time.monotonic()
            process = self.pool.take(self.plan)
            self.waited += time.monotonic() - begun
            if self.pool.closed or process.has_ended():  # the latter is no flight's fault
                self._end(process)
            elif not process.is_silent(0.0):
                self._note_surplus()
                self._end(process)
            elif is_proven and process.unproven:
                self._end(process)
            else:
                return process

    def _start(self) -> float:
        """Return the seconds that a program may take to start, beyond those of a flight."""
        if self.plan.python:
            return 0.0  # it says itself when it is loaded
        before, limit = self.record.start, self.plan.start_limit
        return limit if before is None else min(limit, _START_TIMES * before + _START_SLACK)

    def _full_proof(self, process: Process) -> float:
        """Return the seconds after which a surplus line would have come."""
        self.record.longest = max(self.record.longest, process.longest)
        return 2.0 * (self.record.longest or process.first_time) + _SLACK

    def _prove(self, process: Process) -> None:
        """Wait for surplus output of a process. Raise OutOfStepError if there is any."""
        if not process.unproven:
            return
        full = self._full_proof(process)
        is_last = process.flights == self.plan.flights_per_process
        if is_last or process.unproven >= _PROOF:
            wait = full
        elif self.plan.is_proven:
            wait = min(full, _SHORT_PROOF)
        else:
            return
        self._wait_for_silence(process, wait, is_last)
        if wait == full:
            process.unproven = 0

    def _wait_for_silence(self, process: Process, seconds: float, is_last: bool) -> None:
        begun = time.monotonic()
        is_silent = process.is_silent(seconds, is_last)
        self.waited += time.monotonic() - begun
        if not is_silent:
            raise OutOfStepError

    def _leave(self, process: Process) -> None:
        """Give a process back, or end it if it has run as many flights as it may."""
        if process.flights == self.plan.flights_per_process:
            self._end(process)
        else:
            self._read_out(process)
            self.pool.give_back(self.plan, process)

    def _end(self, process: Process | None) -> None:
        if process is not None:
            self.pool.end(process)
            self._read_out(process)
            self.events["restarts"] += 1
        if self.pool.closed:
            raise StoppedError("the campaign was stopped")

    def _read_out(self, process: Process) -> None:
        """Take what a process says of itself: the time of its start, and its standard error."""
        if process.flights:
            self.record.start = max(self.record.start or 0.0, process.first_time)
        if text := process.take_errors():
            self.errors = [*self.errors[:2], *self.errors[2:][-2:], text]

    def _note_surplus(self) -> None:
        self.record.surplus += 1
        self.events["surplus"] += 1

    def _keep(self, flight: int, answer: dict[str, Any]) -> None:
        """Store what a flight returned. Raise LostFlightError if a program's line is no answer."""
        try:
            outcome, end_time, metrics, history = read_answer(answer, self.plan)
        except ValueError as error:
            if self.plan.command and "error" not in answer:
                raise LostFlightError(str(error)) from None  # what follows may be of any flight
            self._lose(flight, str(error))
            return
        self.outcome[flight], self.end_time[flight] = outcome, end_time
        self.metrics[flight] = metrics
        if self.with_histories and history is not None:
            self.histories[flight] = history

    def _lose(self, flight: int, reason: str) -> None:
        """Store that a flight failed to run."""
        self.outcome[flight] = Outcome.FAILED_TO_RUN
        self.end_time[flight] = self.metrics[flight] = np.nan
        self.histories.pop(flight, None)
        _tell(self.plan, reason + self.plan.name_undeclared(reason))


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
    held = found.keys() - {"outcome", "end_time", "flight"}
    if held != plan.expected:
        for name in sorted(held - plan.expected):
            raise ValueError(f"it returned '{name}', which the campaign does not declare")
        raise ValueError(f"it did not return {', '.join(sorted(plan.expected - held))}")
    values = [_read_number(found[metric.name], metric.name) for metric in plan.metrics]
    end = _read_number(found.get("end_time"), "end_time")
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


def _read_number(value: Any, name: str) -> float:
    """Return a JSON number, NaN for null. Raises ValueError for anything else."""
    if value is None:
        return math.nan
    if type(value) is float:
        return value
    if type(value) is int and abs(value) < _LARGEST:
        return float(value)
    hint = "too large" if type(value) is int else "no number"
    if isinstance(value, bool):
        hint += f" (return {int(value)} for it)"
    raise ValueError(f"it returned {json.dumps(value):.40} for {name}, which is {hint}")


def _read_history(given: Any, plan: UserPlan, ok: bool) -> Floats:
    """Time and channels [column, sample] of a flight. Raises ValueError where they are none."""
    columns = ["time", *(channel.name for channel in plan.channels)]
    if not isinstance(given, dict) or given.keys() != set(columns):
        held = ", ".join(given) if isinstance(given, dict) else f"{given!r:.80}"
        raise ValueError(
            f"its history holds {held or 'nothing'}; declared are {', '.join(columns)}"
        )
    try:
        lists = [np.array(given[name]) for name in columns]
        is_text = any(column.dtype.kind in "Ub" for column in lists)
        history = np.array([] if is_text else lists, np.float64)
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
