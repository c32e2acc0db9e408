"""Flights of a custom simulator; a crash or hang affects only the current flight.

Each reply must belong to its request. A silence check waits for surplus output, that is, lines that
no request asked for.
"""

import json
import math
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.external_simulators.process import (
    LostFlightError,
    OutOfStepError,
    Process,
    StoppedError,
    current_pool,
)
from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.flights.blocks import FlightBlock, Recording
from abhv_mc.flights.expressions import compile_formula
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import is_exhausted, notify, quoted
from abhv_mc.statistics.circular import unwrap

_NEAR = 1e-6  # tolerance of sample times relative to the sampling interval
_LARGEST = 1 << 1023  # bound on integers that can be converted to float


class Answer(NamedTuple):
    """Validated result of one flight."""

    outcome: int
    end_time: float
    metrics: list[float]
    # [column, sample] time and channels, or None if the campaign declares no channels
    history: Floats | None


def read_answer(reply: dict[str, Any], plan: UserPlan) -> Answer:
    """Validate a reply. Raise ValueError if the reply does not match the campaign."""
    if "error" in reply:
        raise ValueError(str(reply["error"]))
    code = reply.get("outcome", "ok")
    if not isinstance(code, str) or code not in plan.outcomes:
        raise ValueError(f"it returned the outcome '{code}', which the campaign does not declare")
    keys = reply.keys() - {"outcome", "end_time", "flight"}
    if keys != plan.expected:
        for name in sorted(keys - plan.expected):
            raise ValueError(f"it returned '{name}', which the campaign does not declare")
        raise ValueError(f"it did not return {quoted(sorted(plan.expected - keys))}")
    values = [
        math.nan if metric.of else _read_number(reply[metric.name], metric.name)
        for metric in plan.metrics
    ]
    end = _read_number(reply.get("end_time"), "end_time")
    ok = code == "ok"
    for record, value in zip(plan.metrics, values, strict=True):
        if ok and not (record.of or math.isfinite(value)):
            raise ValueError(f"'{record.name}' is not a finite number although the outcome is 'ok'")
    history = _read_history(reply["history"], plan, ok) if plan.channels else None
    if history is not None:
        _add_robustness(values, plan, history)
    return Answer(plan.outcomes[code], end if ok or math.isfinite(end) else 0.0, values, history)


def _add_robustness(values: list[float], plan: UserPlan, history: Floats) -> None:
    """Set the metrics that are defined by formulas, from the history at the rate of storage."""
    names = [channel.name for channel in plan.channels]
    for i, metric in enumerate(plan.metrics):
        if metric.of:
            _, histories = sample_histories({0: history}, 1, len(names), plan.rate)
            formula = compile_formula(metric.of, plan.rate)
            columns = [names.index(name) for name in formula.sources]
            samples = histories[0, :, columns].T.astype(np.float64)
            values[i] = formula.find_robustness(samples, math.nan)


def _read_number(value: Any, name: str) -> float:
    """Return a JSON number, or NaN for null. Raise ValueError for other values."""
    if value is None:
        return math.nan
    if type(value) is float:
        return value
    if type(value) is int and abs(value) < _LARGEST:
        return float(value)
    hint = "too large" if type(value) is int else "not a number"
    if isinstance(value, bool):
        hint += f" (return {int(value)} instead)"
    raise ValueError(f"it returned {json.dumps(value):.40} for {name}, which is {hint}")


def _read_history(reply: Any, plan: UserPlan, ok: bool) -> Floats:
    """Return the time and channels [column, sample] of a history; angles are continuous.

    Raise ValueError if the history is invalid.
    """
    columns = ["time", *(channel.name for channel in plan.channels)]
    if not isinstance(reply, dict) or reply.keys() != set(columns):
        contents = quoted(reply) if reply and isinstance(reply, dict) else f"{reply!r:.80}"
        raise ValueError(
            f"its history contains {contents}, but the campaign declares {quoted(columns)}"
        )
    try:
        lists = [np.array(reply[name]) for name in columns]
        is_text = any(column.dtype.kind in "Ub" for column in lists)
        history = np.array([] if is_text else lists, np.float64)
    except (TypeError, ValueError, OverflowError):
        history = np.empty(0)
    if history.ndim != 2 or not history.size:
        raise ValueError("the columns of its history are not lists of numbers of equal length")
    if not np.isfinite(history[0]).all() or (np.diff(history[0]) < 0.0).any():
        raise ValueError("the column 'time' of its history is not finite or does not ascend")
    if ok and not np.isfinite(history).all():
        name = columns[int(np.argmin(np.isfinite(history).all(axis=1)))]
        raise ValueError(
            f"'{name}' in its history is not a finite number although the outcome is 'ok'"
        )
    for row, channel in zip(history[1:], plan.channels, strict=True):
        row[:] = unwrap(row, channel.period)
    return history


def sample_histories(
    histories: Mapping[int, Floats], flights: int, channels: int, rate: float, beyond: int = 0
) -> tuple[Floats, Singles]:
    """Return times [time] in s, and histories [flight, time, channel] at these times.

    Times have ``rate`` samples per second and extend ``beyond`` samples on either side of the
    flights. Histories are interpolated linearly, and are NaN before and after a flight.
    """
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
        own = slice(*(index - first for index in spans[flight]))
        for i, column in enumerate(columns):
            sampled[flight, own, i] = np.interp(times[own], clock, column)
    return times, sampled


def find_extremes(
    histories: Mapping[int, Floats], times: Floats, sampled: Singles
) -> tuple[Singles, Singles]:
    """Return the extremes [time, channel] over all flights between neighbouring times.

    Extremes cover returned samples and the lines between samples. ``times`` extend beyond all
    flights.
    """
    placed = [
        (np.unique(np.searchsorted(times, history[0]), return_index=True), history[1:])
        for history in histories.values()
    ]
    ends = []
    for extreme in (np.fmin, np.fmax):
        at_times = np.full((times.size + 2, sampled.shape[2]), np.nan, np.float32)
        at_times[1:-1] = extreme.reduce(sampled, axis=0)
        between = np.full(
            (times.size + 1, sampled.shape[2]), np.nan, np.float32
        )  # extremes of the returned samples in each interval between neighbouring times
        for (interval, first), columns in placed:
            between[interval] = extreme(
                between[interval], extreme.reduceat(columns, first, axis=1).T
            )
        ends.append(
            extreme.reduce([at_times[:-2], at_times[1:-1], at_times[2:], between[:-1], between[1:]])
        )
    return ends[0], ends[1]


_AHEAD = 1e-3  # computing time of a flight in s below which requests are sent ahead of replies
_SLACK = 0.02  # time in s of a silence check in addition to twice the longest reply time
_SHORT_PROOF = 0.25  # duration in s of a silence check after few flights
_PROOF = 20  # number of flights of a process after which its silence checks take the full time
_RARE = 300  # intended average number of pieces between two surplus lines
# limits on the start time: a multiple of earlier start times, and a time in s
_START_TIMES, _START_SLACK = 10.0, 10.0


class _Record:
    """Times and surplus output of the flights of one system in this process."""

    def __init__(self) -> None:
        self.seconds = 0.0  # mean computing time in s of a flight in the last block
        # longest reply time in s before each recent silence check
        self.longest: deque[float] = deque(maxlen=_PROOF)
        self.start: float | None = None  # longest time in s to a first reply
        self.is_stuck = False  # whether a process exceeded its start limit without a reply
        self.flights = self.surplus = 0


_records: dict[object, _Record] = defaultdict(_Record)
_told: set[str] = set()  # reasons already printed


def seconds_of_a_flight(plans: Iterable[Any]) -> float:
    """Return the mean time (s) of recent flights of the slowest system, initially 0."""
    return max(_records[plan.system].seconds for plan in plans)


def note_surplus(plan: UserPlan, flights: int, surplus: int) -> None:
    """Add the numbers of flights and surplus lines that other machines observed."""
    record = _records[plan.system]
    record.flights += flights
    record.surplus += surplus


def with_surplus(plan: UserPlan) -> UserPlan:
    """Return the plan with the counts of surplus lines, for use by another process."""
    record = _records[plan.system]
    return replace(plan, seen=(record.flights, record.surplus))


def fly_user_simulator(
    plan: UserPlan, rows: Floats, recorded: Recording | int | None = None
) -> FlightBlock:
    """Simulate ``rows`` [flight, input] in the units of the inputs.

    Flights that cannot be computed get the outcome ``failed_to_run``. ``recorded`` is a Recording
    for envelopes, or the factor by which the sampling rate of stored histories is reduced.
    """
    for_bands = isinstance(recorded, Recording)
    rate = plan.band_rate if isinstance(recorded, Recording) else plan.rate / (recorded or 1)
    flights = _Flights(plan, rows, bool(recorded))
    flights.run()
    histories, number = flights.histories, len(rows)
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
        reasons=flights.reasons,
        events=dict(flights.events),
        standard_error="".join(flights.errors),
    )


class _Flights:
    """Flights of one call with their results.

    Replies that do not repeat the text of their request are matched by order. One surplus line
    would therefore assign the results of another flight to every later flight. Surplus lines are
    detected only when the process is idle: flights are accepted if the process is silent
    afterwards, and are computed again otherwise.
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
        self.reasons: dict[int, str] = {}
        self.pool = current_pool()
        self.record = _records[plan.system]
        flights, surplus = plan.seen
        self.record.flights = max(self.record.flights, flights)
        self.record.surplus = max(self.record.surplus, surplus)
        self.waited = 0.0  # time in s spent on process starts and silence checks
        self.is_ahead = 0.0 < self.record.seconds < _AHEAD

    def run(self) -> None:
        """Simulate all flights."""
        number, begun = len(self.requests), time.monotonic()
        self._run_pieces(0, number)
        self.record.flights += number
        if number:
            self.record.seconds = max(0.0, time.monotonic() - begun - self.waited) / number

    def _run_pieces(self, first: int, stop: int, largest: int | None = None) -> None:
        """Simulate flights in checked batches, which are smaller after surplus output."""
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
        """Simulate consecutive flights without a silence check in between."""
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
                if is_exhausted(lost):
                    raise  # No flight caused this error.
                unproven = process.unproven if process else 0
                self._end(process)
                if not unproven:
                    self._lose(done, str(lost))
                elif self._run_alone(done) and done > begun:
                    # This flight did not cause the surplus line.
                    self.record.surplus += 1
                    self.events["repeated"] += done - begun
                    for flight in range(begun, done):
                        self._run_alone(flight)
                done += 1

    def _run_alone(self, flight: int) -> bool:
        """Simulate a flight between two silence checks; return whether both succeed."""
        plan, process = self.plan, None
        try:
            process = self._take(is_proven=True)
            for answer in process.answers(
                self.requests[flight : flight + 1], plan.time_limit, start=self._start()
            ):
                self._keep(flight, answer)
            self._wait_for_silence(
                process, self._full_proof(process), process.flights == plan.flights_per_process
            )
            self._note_proof(process)
            self._leave(process)
        except OutOfStepError:
            self._end(process)
            self._note_surplus()
            self._lose(flight, "it replied twice")
            return False
        except (LostFlightError, OSError) as lost:
            if is_exhausted(lost):
                raise
            self._end(process)
            self._lose(flight, str(lost))
            return False
        return True

    def _take(self, is_proven: bool = False) -> Process:
        """Return an idle process without output since its last reply, or else a new process."""
        while True:
            begun = time.monotonic()
            process = self.pool.take(self.plan)
            self.waited += time.monotonic() - begun
            if self.pool.closed or (process.flights and process.has_ended()):
                self._end(process)  # The process ended while idle.
            elif process.flights and not process.is_silent(0.0):
                self._note_surplus()
                self._end(process)
            elif is_proven and process.unproven:
                self._end(process)
            else:
                return process

    def _start(self) -> float:
        """Return the time (s) allowed for the start of a program, besides the time of a flight."""
        if self.plan.python:
            return 0.0  # Python simulators send a message once they are loaded.
        if self.record.is_stuck:
            return 0.0  # Waiting for the time limit in each flight would take hours.
        before, limit = self.record.start, self.plan.start_limit
        return limit if before is None else min(limit, _START_TIMES * before + _START_SLACK)

    def _full_proof(self, process: Process) -> float:
        """Return the time (s) after which a surplus line would have arrived."""
        longest = max(process.longest, *self.record.longest, 0.0)
        return 2.0 * (longest or process.first_time) + _SLACK

    def _prove(self, process: Process) -> None:
        """Check that a process is silent. Raise OutOfStepError if there is surplus output."""
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
            self._note_proof(process)

    def _note_proof(self, process: Process) -> None:
        if process.longest:
            self.record.longest.append(process.longest)
        process.unproven, process.longest = 0, 0.0

    def _wait_for_silence(self, process: Process, seconds: float, is_last: bool) -> None:
        begun = time.monotonic()
        is_silent = process.is_silent(seconds, is_last)
        self.waited += time.monotonic() - begun
        if not is_silent:
            raise OutOfStepError

    def _leave(self, process: Process) -> None:
        """Return a process to the pool, or end it after the maximum number of flights."""
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
        """Record the start time and the standard error output of a process."""
        if process.flights:
            self.record.start = max(self.record.start or 0.0, process.first_time)
        self.record.is_stuck = self.record.start is None and process.has_timed_out
        if text := process.take_errors():
            self.errors = [*self.errors[:2], *self.errors[2:][-2:], text]

    def _note_surplus(self) -> None:
        self.record.surplus += 1
        self.events["surplus"] += 1

    def _keep(self, flight: int, answer: dict[str, Any]) -> None:
        """Store the reply of a flight. Raise LostFlightError if the reply is invalid."""
        try:
            outcome, end_time, metrics, history = read_answer(answer, self.plan)
        except ValueError as error:
            if self.plan.command and "error" not in answer:
                raise LostFlightError(
                    str(error)
                ) from None  # Later output cannot be assigned to flights.
            self._lose(flight, str(error))
            return
        self.outcome[flight], self.end_time[flight] = outcome, end_time
        self.metrics[flight] = metrics
        self.reasons.pop(flight, None)
        if self.with_histories and history is not None:
            self.histories[flight] = history

    def _lose(self, flight: int, reason: str) -> None:
        """Record that a flight failed to run."""
        self.outcome[flight] = Outcome.FAILED_TO_RUN
        self.end_time[flight] = self.metrics[flight] = np.nan
        self.histories.pop(flight, None)
        self.reasons[flight] = reason = reason + self.plan.name_undeclared(reason)
        _tell(self.plan, reason)


def _tell(plan: UserPlan, reason: str) -> None:
    which = "a check or trial flight before the campaign" if plan.check > 0 else "a flight"
    if (message := f"'{plan.controller}': {which} could not be computed: {reason}") not in _told:
        _told.add(message)
        notify(message)
