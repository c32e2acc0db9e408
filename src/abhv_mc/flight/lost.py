"""Flights of native code in a process that may be lost with them, and the row of a flight that was."""

import sys
from collections.abc import Callable

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.arguments import Kept
from abhv_mc.flight.outcome import Outcome, find_lost_outcome
from abhv_mc.flight.plan import FlightBlock, FlightPlan, Recording, join_blocks
from abhv_mc.kernel.plant.state import N_STATES
from abhv_mc.user_code.child import LostError, in_child

_LIMIT = 60.0  # s for up to 16 flights
_FEW = 16
_compiled: set[int] = set()  # numbers of lanes whose flights the child has, or finds on disk


def fly_in_child(
    fly: Callable[..., FlightBlock],
    plan: FlightPlan,
    parameters: Floats,
    recording: Recording,
    lanes: int,
    keep_states: bool,
    start: Kept | None = None,
) -> FlightBlock:
    """What ``fly`` gives in the child: a flight that is lost alone twice has an outcome that says so."""

    if lanes not in _compiled:  # which is no flight's time
        in_child(fly, plan, parameters[:0], recording, lanes, keep_states)
        _compiled.add(lanes)

    def attempt(rows: Floats) -> FlightBlock:
        limit = _LIMIT * -(-len(rows) // _FEW)
        return in_child(fly, plan, rows, recording, lanes, keep_states, start, limit=limit)

    try:
        return attempt(parameters)
    except LostError:
        if start is not None:
            raise
        if len(parameters) > 1:
            rows = (row[None] for row in parameters)
            return join_blocks([fly_in_child(fly, plan, row, recording, lanes, keep_states) for row in rows])
    try:
        return attempt(parameters)
    except LostError as lost:
        print(f"{plan.controller}: the law was lost with a flight: {lost.words}", file=sys.stderr, flush=True)
        outcome = find_lost_outcome(plan.law, lost.hung)
        return make_lost(plan, outcome, recording, len(plan.metrics), keep_states)


def make_lost(
    plan: FlightPlan, outcome: Outcome, recording: Recording, metrics: int, keep_states: bool = False
) -> FlightBlock:
    """The row of one flight of which nothing is known."""
    times = np.arange(recording.count_samples(plan.timing)) * (recording.every * plan.timing.tick)
    return FlightBlock(
        outcome=np.array([outcome], np.int64),
        end_time=np.full(1, np.nan),
        metrics=np.full((1, metrics), np.nan),
        history=np.full((1, len(times), len(recording.channels)), np.nan, np.float32),
        times=times.astype(np.float64),
        states=np.full((1, len(times) if keep_states else 0, N_STATES), np.nan),
    )
