"""Once a tick, at the state of the tick: derived quantities, the end of a flight and the recorded channels.

What is observed comes from the tables of :mod:`abhv_mc.flight.channels` and :mod:`abhv_mc.flight.outcome`, as numbers
that the compiled code reads.
"""

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.control.laws.user import FAULT
from abhv_mc.flight import counting, derived
from abhv_mc.flight.channels import CHANNELS, SOURCES
from abhv_mc.flight.derived import FIRST_DERIVED, end_ripples, follow_ripples, remember_start
from abhv_mc.flight.outcome import LIMITS, Limits, Outcome
from abhv_mc.jit import lanes
from abhv_mc.numerics.tables import natural
from abhv_mc.plant import state as s
from abhv_mc.plant.state import STATE_INDEX, X
from abhv_mc.vehicle.arrays import VARIABLES

_DEG = 180.0 / math.pi
_NOT_FINITE = float(Outcome.NOT_FINITE)
_FLOWN = 0.5  # verdict of a flight that has met its mission's end: below every limit's code, and OK as a whole number

# Rows of the observer's own block: of every lane, then what metrics keep, see abhv_mc.flight.counting.
ALIVE, OUTCOME, END, SAMPLES = range(4)  # END: tick of the last sample that counted
FIRST_METRIC = 4
N_ROWS = FIRST_METRIC + counting.N_ROWS


def _row_in_memory(source: str) -> int | None:
    """The row of the lane memory that holds a source; None for what is derived."""
    if source in STATE_INDEX:
        return X + STATE_INDEX[source]
    if source in VARIABLES:
        return s.variable_row(source)
    return getattr(s, source.upper(), getattr(derived, source.upper(), None))


# The sources that are derived, each once, and a row for each.
_SOURCES = [*(limit.source for limit in LIMITS), *(source.source for source in SOURCES.values())]
DERIVED = tuple(dict.fromkeys(source for source in _SOURCES if _row_in_memory(source) is None))
VERDICT = FIRST_DERIVED + len(DERIVED)  # outcome of the limits at this tick, 0 within all of them
END_ROW = VERDICT + 1  # of the lane memory


def find_row(source: str) -> int:
    """Row of the lane memory where a source stands. Raises ValueError for one that there is not."""
    row = _row_in_memory(source)
    if row is None and source not in DERIVED:
        raise ValueError(f"'{source}' is no row of the lane memory and no function of abhv_mc.flight.derived")
    return FIRST_DERIVED + DERIVED.index(source) if row is None else row


_ERRORS = tuple(find_row(name) for name in ("bank_error_deg", "angle_of_attack_error_deg", "sideslip"))


def find_factor(source: str, unit: str) -> float:
    """What turns the row of a source into a unit: rows are in SI and radians, derived quantities in their own unit."""
    return _DEG if unit in ("deg", "deg/s") and source not in DERIVED and not source.endswith("_deg") else 1.0


def _compose(functions: Sequence[Callable[..., Any]], row: int) -> Callable[..., None]:
    """One compiled function that puts what each of these returns for a lane into its own row, from ``row`` on."""
    if len(functions) == 1:
        function = functions[0]

        @lanes
        def derive_one(Z, lane, plan, tick):
            Z[row, lane] = function(Z, lane, plan, tick)

        return derive_one
    half = len(functions) // 2
    some, others = _compose(functions[:half], row), _compose(functions[half:], row + half)

    @lanes
    def derive_more(Z, lane, plan, tick):
        some(Z, lane, plan, tick)
        others(Z, lane, plan, tick)

    return derive_more


_derive_lane = _compose([getattr(derived, source) for source in DERIVED], FIRST_DERIVED)


class Observed(NamedTuple):
    """The tables of limits and channels as numbers; rows of the lane memory."""

    limit_row: Ints  # [limit]
    limit_outcome: Floats  # [limit]
    limit_low: Floats  # [limit]
    limit_high: Floats  # [limit]
    channel_row: Ints  # [channel]
    channel_factor: Floats  # [channel]


def make_observed(limits: Limits, channels: tuple[int, ...]) -> Observed:
    """The tables for one plan's limits and the recorded ``channels`` of CHANNELS."""
    bounded = [limit for limit in LIMITS if any(map(math.isfinite, limit.bounds(limits)))]  # perhaps none
    bounds = np.array([limit.bounds(limits) for limit in bounded], np.float64).reshape(-1, 2)
    return Observed(
        np.array([find_row(limit.source) for limit in bounded], np.int64),
        np.array([float(limit.outcome) or _FLOWN for limit in bounded], np.float64),
        bounds[:, 0].copy(),
        bounds[:, 1].copy(),
        *_channel_tables(channels),
    )


@cache
def _channel_tables(channels: tuple[int, ...]) -> tuple[Any, ...]:
    recorded = [CHANNELS[i] for i in channels]
    return (
        np.array([find_row(channel.source) for channel in recorded], np.int64),
        np.array([find_factor(channel.source, channel.unit) for channel in recorded], np.float64),
    )


@lanes
def start_observing(Z, O, width, counted):
    """Metrics at their beginning, every lane alive."""
    remember_start(Z, width)
    counting.start_counting(O, width, counted, FIRST_METRIC)
    for lane in range(width):
        for i in range(FIRST_METRIC):
            O[i, lane] = 0.0
        O[ALIVE, lane] = 1.0


@lanes
def derive(Z, width, plan, tick):
    """The derived quantities at this tick."""
    observing = derived.Observing(plan.reference, plan.timing, plan.vehicle.constants)
    for lane in range(width):
        _derive_lane(Z, lane, observing, tick)
    follow_ripples(Z, width, observing, tick, _ERRORS)


@lanes
def check_limits(Z, O, width, observed, tick):
    """End the flights that left their limits or are no longer finite: how many. Metrics keep what was counted."""
    ended = 0.0
    for lane in range(width):
        Z[VERDICT, lane] = 0.0
    for i in range(observed.limit_row.size):
        check_limit(
            Z[VERDICT],
            Z[natural(observed.limit_row[i])],
            observed.limit_low[i],
            observed.limit_high[i],
            observed.limit_outcome[i],
            width,
        )
    for lane in range(width):
        alive = O[ALIVE, lane]
        total = 0.0
        for i in range(s.N_STATES):
            total += Z[X + i, lane]
        finite = total - total == 0.0
        verdict = Z[FAULT, lane] if Z[FAULT, lane] > 0.0 else Z[VERDICT, lane]
        verdict = verdict if finite else _NOT_FINITE
        ends = alive > 0.0 and verdict > 0.0
        O[OUTCOME, lane] = verdict if ends else O[OUTCOME, lane]
        # A last finite sample still counts; a broken one does not.
        counts = alive if finite else 0.0
        O[END, lane] = float(tick) if alive > 0.0 else O[END, lane]
        O[SAMPLES, lane] += counts
        O[ALIVE, lane] = 0.0 if ends else alive
        Z[s.COUNTED, lane] = counts
        ended += 1.0 if ends else 0.0
    return ended


@lanes
def finish_flights(Z, O, width, plan, tick):
    """What metrics count of flights that have ended, at this tick or before."""
    for lane in range(width):
        if tick == plan.timing.ticks or O[ALIVE, lane] == 0.0:
            end_ripples(Z, lane, plan)


@lanes
def check_limit(verdict, value, low, high, outcome, width):
    """One limit in all lanes; a NaN is inside, the state itself is checked."""
    for lane in range(width):
        verdict[lane] = outcome if value[lane] < low or value[lane] > high else verdict[lane]


@lanes
def record(Z, observed, history, flights, n, sample):
    """The recorded channels at this tick, of the lanes' ``flights`` that still fly."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            row = history[flights[lane], sample]
            for i in range(observed.channel_row.size):
                row[i] = Z[natural(observed.channel_row[i]), lane] * observed.channel_factor[i]


@lanes
def record_states(Z, states, flights, n, sample):
    """The whole state at this tick, in the order of STATES and in double precision, for the flights that still fly."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            for i in range(s.N_STATES):
                states[flights[lane], sample, i] = Z[X + i, lane]
