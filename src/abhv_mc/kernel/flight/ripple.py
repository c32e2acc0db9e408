"""Cycles of an angle about its command while the reference is settled: a few numbers a lane, tick by tick.

Zero is the mean of the error since the settled stretch began. A side ends when the error lies on the other one by half
of the distance of its own farthest point, 0.01 deg at least. Three sides one after another, the last as far as it
has got when the stretch or the flight ends, are a cycle where the smaller of the two swings between their farthest
points is at least half the larger. Its size is the larger swing (of the error itself), its frequency 1 / (time from
the first of the three points to the third).
"""

import math

from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.numerics.angles import larger

# Rows of one angle: the mean; the farthest point of this side (not a number before the first) and its tick, that of the
# side before and its tick, the swing that led to that one and the tick of its beginning; the largest cycle (deg)
# whose third side has ended, or its stretch or flight, and its frequency (Hz).
MEAN, FARTHEST, TICK, LAST, LAST_TICK, SWING, FIRST_TICK, LARGEST, FREQUENCY = range(9)
N_RIPPLE_ROWS = 9
LEAST = 0.01  # deg on the other side end a side, at the least
HALF = 0.5


@lanes
def begin_stretch(Z, width, row):
    """Nothing has been seen of a settled stretch."""
    for lane in range(width):
        Z[row + MEAN, lane] = 0.0
        Z[row + FARTHEST, lane] = math.nan
        Z[row + LAST, lane] = math.nan
        Z[row + SWING, lane] = math.nan


@lanes
def watch_sides(Z, width, row, error, factor, share, tick):
    """How many lanes' error (deg: row ``error`` times ``factor``) has changed sides; :func:`change_side` follows up.

    ``share``: of this tick in the mean, 1 / ticks of the stretch.
    """
    changes = 0.0
    for lane in range(width):
        value, mean, farthest = (
            Z[error, lane] * factor,
            Z[row + MEAN, lane],
            Z[row + FARTHEST, lane],
        )
        farther = (value - farthest) * (
            farthest - mean
        ) > 0.0  # before the mean moves: it may pass the farthest point
        farthest = value if farther else farthest
        mean += (value - mean) * share
        Z[row + MEAN, lane] = mean
        Z[row + FARTHEST, lane] = farthest
        Z[row + TICK, lane] = tick if farther else Z[row + TICK, lane]
        changes += 1.0 if _changes(value - mean, farthest - mean) else 0.0
    return changes


@lanes
def _changes(now, farthest):
    """Whether the error lies far enough on the other side of the mean; ``farthest`` is not a number before any side."""
    return (not now * farthest >= 0.0) & (abs(now) >= larger(LEAST, HALF * abs(farthest)))


@lanes
def change_side(Z, lane, row, error, tick, length):
    """Another side begins where the error has changed sides; ``length``: of a tick, s."""
    farthest, mean = Z[row + FARTHEST, lane], Z[row + MEAN, lane]
    if _changes(error - mean, farthest - mean):
        keep_cycle(Z, lane, row, length)
        Z[row + SWING, lane] = abs(farthest - Z[row + LAST, lane])
        Z[row + FIRST_TICK, lane] = Z[row + LAST_TICK, lane]
        Z[row + LAST, lane] = farthest
        Z[row + LAST_TICK, lane] = Z[row + TICK, lane]
        Z[row + FARTHEST, lane] = error
        Z[row + TICK, lane] = tick


@lanes
def keep_cycle(Z, lane, row, length):
    """Keep the cycle of the last three sides where it is the largest so far; ``length``: of a tick, s."""
    before, swing = Z[row + SWING, lane], abs(Z[row + FARTHEST, lane] - Z[row + LAST, lane])
    size = larger(before, swing)
    if before >= HALF * swing and swing >= HALF * before and size > Z[row + LARGEST, lane]:
        Z[row + LARGEST, lane] = size
        Z[row + FREQUENCY, lane] = 1.0 / (
            (Z[row + TICK, lane] - Z[row + FIRST_TICK, lane]) * length
        )
