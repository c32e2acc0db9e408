"""Cycles of an angle about its command while the reference is settled: a few numbers a lane, tick by tick.

A swing goes from one turning point of the error to the next. It is looked for twice, as a large slow cycle may carry a
small fast one: a quick swing has turned when the way back is a quarter of it, a slow one at 0.35 of it or of the one
before. A cycle is three swings one after another, each at least half of the one before, and none more
than twice as long in time as another. Its amplitude is the largest of the three, from side to side, its frequency that
of the three half periods. A slow decay, a drift, or the one swing after a step is none. A settled stretch begins anew:
its first swing begins at no turning point and does not count.
"""

from abhv_mc.jit import lanes
from abhv_mc.numerics.angles import larger, smaller

# Rows of one angle: the last turning point and its time, the farthest point since and its time, sizes and lengths of
# the last two swings (sizes negative where one began at no turning point), the stage, and the frequency of the largest
# cycle so far and its size. Stage: 0 nothing seen, 0.5 no motion yet, +-1 moving since the beginning, +-2 since a
# turning point; its sign is that of the motion.
TURN, TURN_TIME, FARTHEST, FARTHEST_TIME, SWING, BEFORE, LENGTH, LENGTH_BEFORE, STAGE, FREQUENCY, LARGEST = range(11)
N_SWING_ROWS = 11
N_RIPPLE_ROWS = 2 * N_SWING_ROWS  # slow swings, then quick ones
SLOW, QUICK = 0.35, 0.25  # of a swing: the way back that makes a turning point
WIGGLE = 0.01  # deg: a shorter way back makes none
_LEAST = 0.5  # of the swing before
_LONGEST = 2.0  # of three swings, times the shortest


@lanes
def watch_swings(Z, width, row, error, factor, settled, time, out):
    """Set ``out`` to 1 in the lanes whose error (deg: row ``error`` times ``factor``) begins or ends a swing, else 0.

    :func:`end_swing` follows these up; ``time`` counts control ticks. This alone runs at every tick.
    """
    quick = row + N_SWING_ROWS
    if settled > 0.0:
        for lane in range(width):
            value = Z[error, lane] * factor
            size = abs(Z[row + FARTHEST, lane] - Z[row + TURN, lane])
            least = larger(WIGGLE, SLOW * larger(size, abs(Z[row + SWING, lane])))
            Z[out, lane] = _watch(Z, lane, row, value, time, least)
        for lane in range(width):
            value = Z[error, lane] * factor
            size = abs(Z[quick + FARTHEST, lane] - Z[quick + TURN, lane])
            Z[out, lane] += _watch(Z, lane, quick, value, time, larger(WIGGLE, QUICK * size))
    else:  # the next settled stretch begins anew
        for lane in range(width):
            Z[out, lane] = 0.0
            for first in (row, quick):
                Z[first + STAGE, lane] = 0.0
                Z[first + SWING, lane] = 0.0
                Z[first + BEFORE, lane] = 0.0


@lanes
def _watch(Z, lane, row, error, time, least):
    """Whether a swing begins or ends; ``least``: the way back that ends one."""
    stage, turn, farthest = Z[row + STAGE, lane], Z[row + TURN, lane], Z[row + FARTHEST, lane]
    since = Z[row + FARTHEST_TIME, lane]
    moving = abs(stage) >= 1.0
    back = (farthest - error) * (1.0 if stage > 0.0 else -1.0)
    farther = moving & (back < 0.0)
    Z[row + FARTHEST, lane] = error if farther else farthest
    Z[row + FARTHEST_TIME, lane] = time if farther else since
    return 1.0 if (moving & (back >= least)) | ((not moving) & ((stage == 0.0) | (error != turn))) else 0.0


@lanes
def end_swing(Z, lane, row, error, time, tick):
    """The amplitude of the cycle whose third swing has just ended, 0 without one.

    ``tick`` is the control period, s. FREQUENCY of ``row`` is that of the larger cycle of both kinds.
    """
    quick = row + N_SWING_ROWS
    slow_size = _end(Z, lane, row, error, time, tick, SLOW, 1.0)
    quick_size = _end(Z, lane, quick, error, time, tick, QUICK, 0.0)
    quicker = Z[quick + LARGEST, lane] > Z[row + LARGEST, lane]
    Z[row + FREQUENCY, lane] = Z[quick + FREQUENCY, lane] if quicker else Z[row + FREQUENCY, lane]
    Z[row + LARGEST, lane] = larger(Z[row + LARGEST, lane], Z[quick + LARGEST, lane])
    return larger(slow_size, quick_size)


@lanes
def _end(Z, lane, row, error, time, tick, share, remembered):
    stage, swing, length = Z[row + STAGE, lane], Z[row + SWING, lane], Z[row + LENGTH, lane]
    begins = stage == 0.0
    turn = error if begins else Z[row + TURN, lane]
    turn_time = time if begins else Z[row + TURN_TIME, lane]
    farthest = error if begins else Z[row + FARTHEST, lane]
    farthest_time = time if begins else Z[row + FARTHEST_TIME, lane]
    moving = abs(stage) >= 1.0
    way = (1.0 if stage > 0.0 else -1.0) if moving else (1.0 if error > turn else (-1.0 if error < turn else 0.0))
    size, back = abs(farthest - turn), (farthest - error) * way
    turned = moving and back >= larger(WIGGLE, share * larger(size, remembered * abs(swing)))
    counts = turned and abs(stage) == 2.0
    # The swing that has ended, after the two before it.
    took, before, took_before = farthest_time - turn_time, Z[row + BEFORE, lane], Z[row + LENGTH_BEFORE, lane]
    shortest, longest = smaller(took, smaller(length, took_before)), larger(took, larger(length, took_before))
    grows = before > 0.0 and swing > 0.0 and swing >= _LEAST * before and size >= _LEAST * swing
    cycle = counts and grows and longest <= _LONGEST * shortest
    amplitude = larger(size, larger(swing, before)) if cycle else 0.0
    largest = Z[row + LARGEST, lane]
    period = (took + length + took_before) * tick
    Z[row + FREQUENCY, lane] = 1.5 / period if amplitude > largest else Z[row + FREQUENCY, lane]
    Z[row + LARGEST, lane] = larger(amplitude, largest)
    Z[row + BEFORE, lane] = swing if turned else before
    Z[row + LENGTH_BEFORE, lane] = length if turned else took_before
    Z[row + SWING, lane] = (size if counts else -size) if turned else swing
    Z[row + LENGTH, lane] = took if turned else length
    first = way if way != 0.0 else 0.5
    Z[row + TURN, lane] = farthest if turned else turn
    Z[row + TURN_TIME, lane] = farthest_time if turned else turn_time
    Z[row + FARTHEST, lane] = error if turned or back < 0.0 else farthest
    Z[row + FARTHEST_TIME, lane] = time if turned or back < 0.0 else farthest_time
    Z[row + STAGE, lane] = -2.0 * way if turned else (stage if moving else first)
    return amplitude
