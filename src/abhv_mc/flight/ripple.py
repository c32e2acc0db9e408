"""Cycles of an angle about its command while the reference is settled: a few numbers a lane, tick by tick.

A swing goes from one turning point of the error to the next. It is looked for twice, as a large slow cycle may carry a
small fast one: a quick swing has turned when the way back is a quarter of it, a slow one at 0.35 of it or of the one
before. A cycle is three swings one after another, each at least half of the one before, and none more
than twice as long in time as another. Its amplitude is the largest of the three, from side to side, its frequency that
of the three half periods. A slow decay, a drift, or the one swing after a step is none. A settled stretch begins anew:
its first swing begins at no turning point and does not count.
"""

import math

from abhv_mc.jit import lanes
from abhv_mc.numerics.angles import larger, smaller

# Rows of one angle: the last turning point (not a number before the first tick) and its time, the farthest point since
# and its time, sizes and lengths of the last two swings (sizes negative where one began at no turning point, 0 before
# any), the sense of the motion (0 without one), the least way back that ends a swing however short, and the frequency
# of the largest cycle so far and its size.
TURN, TURN_TIME, FARTHEST, FARTHEST_TIME, SWING, BEFORE, LENGTH, LENGTH_BEFORE, WAY, LEAST, FREQUENCY, LARGEST = range(
    12
)
N_SWING_ROWS = 12
N_RIPPLE_ROWS = 2 * N_SWING_ROWS  # slow swings, then quick ones
SLOW, QUICK = 0.35, 0.25  # of a swing: the way back that makes a turning point
WIGGLE = 0.01  # deg: a shorter way back makes none
_SMALLEST = 0.5  # of the swing before
_LONGEST = 2.0  # of three swings, times the shortest


@lanes
def begin_swings(Z, width, row):
    """A settled stretch, of which nothing has been seen."""
    for first in (row, row + N_SWING_ROWS):
        for lane in range(width):
            Z[first + TURN, lane] = math.nan
            Z[first + FARTHEST, lane] = 0.0
            Z[first + SWING, lane] = 0.0
            Z[first + BEFORE, lane] = 0.0
            Z[first + WAY, lane] = 0.0
            Z[first + LEAST, lane] = 0.0


@lanes
def watch_swings(Z, width, row, error, factor, time, out):
    """Set ``out`` above 0 in lanes whose error (deg: row ``error`` times ``factor``) begins or ends a swing, else 0.

    :func:`end_swing` follows these up; ``time`` counts control ticks. This alone runs at every settled tick.
    """
    for lane in range(width):
        value = Z[error, lane] * factor
        slow = _watch(Z, lane, row, value, time, SLOW)
        Z[out, lane] = slow + _watch(Z, lane, row + N_SWING_ROWS, value, time, QUICK)


@lanes
def _watch(Z, lane, row, error, time, share):
    """Whether a swing begins or ends; ``share`` of it: the way back that ends one."""
    turn, farthest, since = Z[row + TURN, lane], Z[row + FARTHEST, lane], Z[row + FARTHEST_TIME, lane]
    back = (farthest - error) * Z[row + WAY, lane]
    farther = back < 0.0
    Z[row + FARTHEST, lane] = error if farther else farthest
    Z[row + FARTHEST_TIME, lane] = time if farther else since
    least = larger(Z[row + LEAST, lane], share * abs(farthest - turn))  # 0 without motion
    return 1.0 if (back >= least) & ((least > 0.0) | (error != turn)) else 0.0


@lanes
def end_swing(Z, lane, row, error, time, tick):
    """The amplitude of the cycle whose third swing has just ended, 0 without one.

    ``tick`` is the control period, s. FREQUENCY of ``row`` is that of the larger cycle of both kinds.
    """
    quick = row + N_SWING_ROWS
    slow_size = _end(Z, lane, row, error, time, tick, SLOW, SLOW)
    quick_size = _end(Z, lane, quick, error, time, tick, QUICK, 0.0)
    quicker = Z[quick + LARGEST, lane] > Z[row + LARGEST, lane]
    Z[row + FREQUENCY, lane] = Z[quick + FREQUENCY, lane] if quicker else Z[row + FREQUENCY, lane]
    Z[row + LARGEST, lane] = larger(Z[row + LARGEST, lane], Z[quick + LARGEST, lane])
    return larger(slow_size, quick_size)


@lanes
def _end(Z, lane, row, error, time, tick, share, share_before):
    """``share`` of the swing, and ``share_before`` of the one before: the way back that ends it."""
    way, swing, length = Z[row + WAY, lane], Z[row + SWING, lane], Z[row + LENGTH, lane]
    moving, begins = way != 0.0, math.isnan(Z[row + TURN, lane])
    turn = error if begins else Z[row + TURN, lane]
    turn_time = time if begins else Z[row + TURN_TIME, lane]
    farthest = error if begins else Z[row + FARTHEST, lane]
    farthest_time = time if begins else Z[row + FARTHEST_TIME, lane]
    way = way if moving else (1.0 if error > turn else (-1.0 if error < turn else 0.0))
    size, back = abs(farthest - turn), (farthest - error) * way
    turned = moving and back >= larger(Z[row + LEAST, lane], share * size)
    counts = turned and swing != 0.0
    # The swing that has ended, after the two before it.
    took, before, took_before = farthest_time - turn_time, Z[row + BEFORE, lane], Z[row + LENGTH_BEFORE, lane]
    shortest, longest = smaller(took, smaller(length, took_before)), larger(took, larger(length, took_before))
    grows = before > 0.0 and swing > 0.0 and swing >= _SMALLEST * before and size >= _SMALLEST * swing
    cycle = counts and grows and longest <= _LONGEST * shortest
    amplitude = larger(size, larger(swing, before)) if cycle else 0.0
    largest = Z[row + LARGEST, lane]
    period = (took + length + took_before) * tick
    Z[row + FREQUENCY, lane] = 1.5 / period if amplitude > largest else Z[row + FREQUENCY, lane]
    Z[row + LARGEST, lane] = larger(amplitude, largest)
    Z[row + BEFORE, lane] = swing if turned else before
    Z[row + LENGTH_BEFORE, lane] = length if turned else took_before
    swing = (size if counts else -size) if turned else swing
    Z[row + SWING, lane] = swing
    Z[row + LENGTH, lane] = took if turned else length
    Z[row + TURN, lane] = farthest if turned else turn
    Z[row + TURN_TIME, lane] = farthest_time if turned else turn_time
    Z[row + FARTHEST, lane] = error if turned or back < 0.0 else farthest
    Z[row + FARTHEST_TIME, lane] = time if turned or back < 0.0 else farthest_time
    Z[row + WAY, lane] = -way if turned else way
    Z[row + LEAST, lane] = larger(WIGGLE, share_before * abs(swing)) if way != 0.0 else 0.0
    return amplitude
