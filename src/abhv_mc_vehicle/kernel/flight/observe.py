"""Limits that end a flight, and recording of channels, states and extremes.

Limits and channels refer to rows of the lane memory, see :mod:`abhv_mc_vehicle.flight.arguments`.
"""

import math

from abhv_mc_vehicle.kernel.flight import counting, derived
from abhv_mc_vehicle.kernel.flight.derived import VERDICT, end_ripples, remember_start
from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws.user import FAULT, NOT_FINITE
from abhv_mc_vehicle.kernel.numerics.lane_math import larger, smaller
from abhv_mc_vehicle.kernel.numerics.tables import natural
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import STATE_INDEX, X
from abhv_mc_vehicle.kernel.plant.vehicle import VARIABLES

# These rows of ``O`` precede the rows of the metrics (abhv_mc_vehicle.kernel.flight.counting).
ALIVE, OUTCOME, END, SAMPLES = range(4)  # END is the tick of the last counted sample.
FIRST_METRIC = 4
N_ROWS = FIRST_METRIC + counting.N_ROWS
END_ROW = VERDICT + 1  # number of rows of the lane memory

MAX_RECORDED = 96  # maximum number of recorded channels
HIDDEN = 2 * MAX_RECORDED  # row of E that contains 0, or NaN in lanes that are not counted
E_ROWS = HIDDEN + 1


def find_row(source: str) -> int:
    """Return a source's row in the lane memory. Raise ValueError if it has no row."""
    if source in STATE_INDEX:
        return X + STATE_INDEX[source]
    if source in VARIABLES:
        return s.variable_row(source)
    row = getattr(s, source.upper(), getattr(derived, source.upper(), None))
    if not isinstance(row, int):
        raise ValueError(f"'{source}' is not the name of a row of the lane memory")
    return row


@lanes
def start_observing(Z, O, width, counted):
    """Initialize the observer's rows, and mark every lane as alive."""
    remember_start(Z, width)
    counting.start_counting(O, width, counted, FIRST_METRIC)
    for lane in range(width):
        for i in range(FIRST_METRIC):
            O[i, lane] = 0.0
        O[ALIVE, lane] = 1.0


@lanes
def check_limits(Z, O, width, observed, states, tick):
    """End flights that violate a limit or whose state is not finite; return their number.

    The metrics of ended flights include the ticks counted so far. ``states`` is the number of
    custom states.
    """
    ended = 0.0
    for lane in range(width):
        Z[VERDICT, lane] = 0.0
    for i in range(observed.limit_row.size):
        low = observed.limit_low[i]
        high = observed.limit_high[i]
        outcome = observed.limit_outcome[i]
        check_limit(Z[VERDICT], Z[natural(observed.limit_row[i])], low, high, outcome, width)
    for lane in range(width):
        alive = O[ALIVE, lane]
        total = 0.0
        for i in range(s.N_STATES):
            total += Z[X + i, lane]
        for i in range(states):
            total += Z[s.CUSTOM_STATE + i, lane]
        finite = total - total == 0.0
        verdict = Z[FAULT, lane] if Z[FAULT, lane] > 0.0 else Z[VERDICT, lane]
        verdict = verdict if finite else NOT_FINITE
        ends = alive > 0.0 and verdict > 0.0
        O[OUTCOME, lane] = verdict if ends else O[OUTCOME, lane]
        # The sample at which a flight ends is counted only if it is finite.
        counts = alive if finite else 0.0
        O[END, lane] = float(tick) if alive > 0.0 else O[END, lane]
        O[SAMPLES, lane] += counts
        O[ALIVE, lane] = 0.0 if ends else alive
        Z[FAULT, lane] = verdict if ends else Z[FAULT, lane]  # ends the calls of the law
        Z[s.COUNTED, lane] = counts
        ended += 1.0 if ends else 0.0
    return ended


@lanes
def finish_flights(Z, O, width, last, length):
    """Complete the ripple cycles of ended flights; ``length`` is the control period, s."""
    for lane in range(width):
        if last or O[ALIVE, lane] == 0.0:
            end_ripples(Z, lane, length)


@lanes
def check_limit(verdict, value, low, high, outcome, width):
    """Check a limit in all lanes; NaN passes because the state is checked separately."""
    for lane in range(width):
        verdict[lane] = outcome if value[lane] < low or value[lane] > high else verdict[lane]


@lanes
def record(Z, observed, history, flights, n, sample):
    """Record the channels of the counted ``flights`` at a tick."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            row = history[flights[lane], sample]
            for i in range(observed.channel_row.size):
                row[i] = Z[natural(observed.channel_row[i]), lane] * observed.channel_factor[i]


@lanes
def record_states(Z, states, flights, n, sample):
    """Record the full state at a tick in double precision, in the order of STATES."""
    for lane in range(n):
        if Z[s.COUNTED, lane] > 0.0:
            for i in range(s.N_STATES):
                states[flights[lane], sample, i] = Z[X + i, lane]


@lanes
def follow_extremes(Z, E, observed, width, fresh):
    """Update the extremes ``E[2 channel + side, lane]`` at a tick; ``fresh`` starts a new bin.

    A bin covers a sample and the ticks before the next sample. Values are compared before the
    channels' factors are applied. Because factors are positive and rounding is monotone, the
    results are bit-identical to the extremes of recorded histories.
    """
    for lane in range(width):
        E[HIDDEN, lane] = 0.0 if Z[s.COUNTED, lane] > 0.0 else math.nan
    for i in range(observed.channel_row.size):
        if fresh:
            forget(E[2 * i], E[2 * i + 1], width)
        widen(E[2 * i], E[2 * i + 1], Z[natural(observed.channel_row[i])], E[HIDDEN], width)


@lanes
def forget(low, high, width):
    """Reset the extremes of a bin."""
    for lane in range(width):
        low[lane] = math.inf
        high[lane] = -math.inf


@lanes
def widen(low, high, row, hidden, width):
    """Widen the extremes to each lane's value; ``hidden`` turns uncounted values into NaN."""
    for lane in range(width):
        value = row[lane] + hidden[lane]
        low[lane] = value if value < low[lane] else low[lane]
        high[lane] = value if value > high[lane] else high[lane]


@lanes
def keep_extremes(E, observed, least, greatest, width):
    """Widen the results ``[channel]`` of a bin to include the extremes of all lanes."""
    for i in range(observed.channel_row.size):
        low = E[2 * i]
        high = E[2 * i + 1]
        smallest = low[0]
        largest = high[0]
        for lane in range(1, width):
            smallest = low[lane] if low[lane] < smallest else smallest
            largest = high[lane] if high[lane] > largest else largest
        factor = observed.channel_factor[i]
        least[i] = smaller(least[i], smallest * factor)
        greatest[i] = larger(greatest[i], largest * factor)
