"""The least and the greatest value of recorded channels over the ticks between two samples, over all flights of a call.

A bin runs from a sample to the tick before the next one. In a bin each lane keeps its own extremes; they go into the
call's result where the bin ends, and before lanes are compacted. What is compared are rows of the lane memory: factors
are positive and rounding keeps the order, so extremes of rows are extremes of what a history would hold, to the bit.
"""

import math

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.numerics.angles import larger, smaller
from abhv_mc.kernel.numerics.tables import natural
from abhv_mc.kernel.plant import state as s

MAX_RECORDED = 96  # channels
HIDDEN = 2 * MAX_RECORDED  # row of E: 0, or NaN in the lanes that do not count
E_ROWS = HIDDEN + 1


@lanes
def follow_extremes(Z, E, observed, width, fresh):
    """Add a tick to the extremes ``E[2 channel + side, lane]`` of the flights that count; ``fresh``: a bin begins."""
    for lane in range(width):
        E[HIDDEN, lane] = 0.0 if Z[s.COUNTED, lane] > 0.0 else math.nan
    for i in range(observed.channel_row.size):
        if fresh:
            forget(E[2 * i], E[2 * i + 1], width)
        widen(E[2 * i], E[2 * i + 1], Z[natural(observed.channel_row[i])], E[HIDDEN], width)


@lanes
def forget(low, high, width):
    """No value seen."""
    for lane in range(width):
        low[lane] = math.inf
        high[lane] = -math.inf


@lanes
def widen(low, high, row, hidden, width):
    """One value in all lanes; a NaN is none, and becomes of what is hidden."""
    for lane in range(width):
        value = row[lane] + hidden[lane]
        low[lane] = value if value < low[lane] else low[lane]
        high[lane] = value if value > high[lane] else high[lane]


@lanes
def keep_extremes(E, observed, least, greatest, width):
    """Widen the result ``[channel]`` of a bin by what the lanes have seen in it."""
    for i in range(observed.channel_row.size):
        low, high = E[2 * i], E[2 * i + 1]
        smallest, largest = low[0], high[0]
        for lane in range(1, width):
            smallest = low[lane] if low[lane] < smallest else smallest
            largest = high[lane] if high[lane] > largest else largest
        factor = observed.channel_factor[i]
        least[i] = smaller(least[i], smallest * factor)
        greatest[i] = larger(greatest[i], largest * factor)
