"""Once a tick, at the state of the tick: derived quantities, the end of a flight and the recorded channels.

Which limits and channels there are comes as numbers, see :mod:`abhv_mc.flight.observed`.
"""

from collections.abc import Callable, Sequence
from typing import Any

from abhv_mc.kernel.flight import counting, derived
from abhv_mc.kernel.flight.derived import DERIVED, FIRST_DERIVED, end_ripples, follow_ripples, remember_start
from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.laws.user import FAULT, NOT_FINITE
from abhv_mc.kernel.numerics.tables import natural
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.state import STATE_INDEX, X
from abhv_mc.kernel.plant.vehicle import VARIABLES

# Rows of the observer's own block: of every lane, then what metrics keep, see abhv_mc.kernel.flight.counting.
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


VERDICT = FIRST_DERIVED + len(DERIVED)  # outcome of the limits at this tick, 0 within all of them
END_ROW = VERDICT + 1  # of the lane memory


def find_row(source: str) -> int:
    """Row of the lane memory where a source stands. Raises ValueError for one that there is not."""
    row = _row_in_memory(source)
    if row is None and source not in DERIVED:
        raise ValueError(f"'{source}' is no row of the lane memory and no function of abhv_mc.kernel.flight.derived")
    return FIRST_DERIVED + DERIVED.index(source) if row is None else row


_ERRORS = tuple(find_row(name) for name in ("bank_error_deg", "angle_of_attack_error_deg", "sideslip"))


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
        verdict = verdict if finite else NOT_FINITE
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
