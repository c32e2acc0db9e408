"""Replies of a custom simulator: their validation, and the sampling of histories."""

import json
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Singles
from abhv_mc.external_simulators.user_plan import UserPlan
from abhv_mc.io.messages import quoted
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
    values = [_read_number(reply[metric.name], metric.name) for metric in plan.metrics]
    end = _read_number(reply.get("end_time"), "end_time")
    ok = code == "ok"
    if ok and not all(map(math.isfinite, values)):
        name = next(
            record.name
            for record, value in zip(plan.metrics, values, strict=True)
            if not math.isfinite(value)
        )
        raise ValueError(f"'{name}' is not a finite number although the outcome is 'ok'")
    history = _read_history(reply["history"], plan, ok) if plan.channels else None
    return Answer(plan.outcomes[code], end if ok or math.isfinite(end) else 0.0, values, history)


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
