"""Results of flights that were computed in one call."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints, Singles
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.timing import Timing
from abhv_mc.identity import Flyer


class Recording(NamedTuple):
    """Specification of the time histories that are recorded."""

    every: int  # number of control ticks between samples; 0 if nothing is recorded
    channels: tuple[int, ...] = ()  # indices into the plan's channels
    extremes: bool = False  # whether to record extremes over all flights and control ticks

    def count_samples(self, timing: Timing) -> int:
        """Return the number of samples of a complete flight."""
        return timing.ticks // self.every + 1 if self.every else 0


def make_recording(request: Recording | int | None, plan: Any) -> Recording:
    """Convert a request to a Recording; an int is the number of ticks between samples.

    If the request is an int, all channels are recorded; if it is None, nothing is recorded.
    """
    return (
        request
        if isinstance(request, Recording)
        else Recording(request or 0, tuple(range(len(plan.channels))))
    )


@dataclass(frozen=True)
class FlightBlock:
    """Results of flights that were simulated in one call, in the order of their parameters."""

    outcome: Ints  # [flight] values of Outcome
    end_time: Floats  # [flight] end time, s
    metrics: Floats  # [flight, metric], in the order of the plan's metrics
    # [flight, time, channel] recorded channels; NaN after the end
    history: Singles = field(default_factory=lambda: np.empty((0, 0, 0), np.float32))
    times: Floats = field(default_factory=lambda: np.empty(0))  # [time] times of the history, s
    # [flight, time, state] recorded states; empty unless requested
    states: Floats = field(default_factory=lambda: np.empty((0, 0, 0)))
    # [time, channel] extremes over all flights and all control ticks between the adjacent times;
    # NaN if there are no flights, None unless requested
    low: Singles | None = None
    high: Singles | None = None
    flown_by: tuple[Flyer, ...] = ()  # processes that computed the block, if results are signed
    reasons: Mapping[int, str] = field(
        default_factory=dict
    )  # reasons why flights failed to run, by row
    # Events of a custom simulator ("surplus", "restarts", "repeated") and an excerpt of its
    # standard error.
    events: Mapping[str, int] = field(default_factory=dict)
    standard_error: str = ""

    @property
    def reason_texts(self) -> tuple[str, ...]:
        """Reason why each flight failed to run, or ''; empty if no flight has a reason."""
        if not self.reasons:
            return ()
        return tuple(self.reasons.get(row, "") for row in range(len(self.outcome)))

    @property
    def extremes(self) -> tuple[Singles, Singles]:
        """Extremes [time, channel] over all ticks if recorded, otherwise over samples."""
        if self.low is None or self.high is None:
            return np.fmin.reduce(self.history, axis=0), np.fmax.reduce(self.history, axis=0)
        return self.low, self.high


def join_blocks(blocks: list[FlightBlock]) -> FlightBlock:
    """Concatenate blocks of flights, without the full states."""
    arrays = {
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in ("outcome", "end_time", "metrics", "history")
    }
    low = _reduce(np.fmin, [block.low for block in blocks if block.low is not None])
    high = _reduce(np.fmax, [block.high for block in blocks if block.high is not None])
    flyers = tuple(dict.fromkeys(flyer for block in blocks for flyer in block.flown_by))
    reasons, first = dict[int, str](), 0
    for block in blocks:
        reasons |= {first + row: reason for row, reason in block.reasons.items()}
        first += len(block.outcome)
    return FlightBlock(
        **arrays,
        times=blocks[0].times,
        low=low,
        high=high,
        flown_by=flyers,
        reasons=reasons,
        events=sum((Counter(block.events) for block in blocks), Counter()),
        standard_error="".join(block.standard_error for block in blocks),
    )


def make_failed_block(
    plan: Any, outcome: Outcome, recording: Recording, metrics: int, states: int = 0
) -> FlightBlock:
    """Return a block for one flight that failed to run, with its outcome but without results.

    ``states`` is the number of recorded states.
    """
    timing = plan.timing  # None if each flight has its own times
    samples = recording.count_samples(timing) if timing else 0
    times = np.arange(samples) * (recording.every * timing.tick if timing else 0.0)
    return FlightBlock(
        outcome=np.array([outcome], np.int64),
        end_time=np.full(1, np.nan),
        metrics=np.full((1, metrics), np.nan),
        history=np.full((1, len(times), len(recording.channels)), np.nan, np.float32),
        times=times.astype(np.float64),
        states=np.full((1, len(times) if states else 0, states), np.nan),
    )


def _reduce(extreme: np.ufunc, extremes: list[Singles]) -> Singles | None:
    return extreme.reduce(extremes) if extremes else None
