"""Oscillation cycles of an angle about its command in settled intervals.

A side is a period in which the error is on one side of its mean since the start of the settled
interval. A side ends when the error has crossed the mean by at least half of the side's largest
distance from the mean, and by at least 0.01 deg. Three successive sides (the last one possibly cut
off by the end of the interval or flight) form a cycle if the smaller of the two swings between
their farthest points is at least half of the larger one. The size of a cycle is its larger swing;
its frequency is the reciprocal of the time between the farthest points of its first and third side.
"""

import math

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.lane_math import larger

# MEAN is the mean error, deg. FARTHEST and TICK are the error and the tick at the farthest point of
# the current side; FARTHEST is NaN before the first side. LAST and LAST_TICK describe the farthest
# point of the previous side. SWING is the swing that ended at LAST and started at FIRST_TICK.
# LARGEST (deg) and FREQUENCY (Hz) describe the largest complete cycle.
MEAN, FARTHEST, TICK, LAST, LAST_TICK, SWING, FIRST_TICK, LARGEST, FREQUENCY = range(9)
N_RIPPLE_ROWS = 9
LEAST = 0.01  # smallest excursion across the mean that ends a side, deg
HALF = 0.5


@lanes
def begin_stretch(Z, width, row):
    """Initialize the rows for a settled interval."""
    for lane in range(width):
        Z[row + MEAN, lane] = 0.0
        Z[row + FARTHEST, lane] = math.nan
        Z[row + LAST, lane] = math.nan
        Z[row + SWING, lane] = math.nan


@lanes
def watch_sides(Z, width, row, error, factor, share, tick):
    """Update the sides; return the number of lanes in which the error has changed sides.

    The error (deg) is row ``error`` times ``factor``. ``share`` is the weight of this tick in the
    mean, 1 / (number of the tick in the interval). If the result is not 0, call
    :func:`change_side` in every lane.
    """
    changes = 0.0
    for lane in range(width):
        value = Z[error, lane] * factor
        mean = Z[row + MEAN, lane]
        farthest = Z[row + FARTHEST, lane]
        farther = (value - farthest) * (
            farthest - mean
        ) > 0.0  # Compare before updating the mean, which may pass the farthest point.
        farthest = value if farther else farthest
        mean += (value - mean) * share
        Z[row + MEAN, lane] = mean
        Z[row + FARTHEST, lane] = farthest
        Z[row + TICK, lane] = tick if farther else Z[row + TICK, lane]
        changes += 1.0 if _changes(value - mean, farthest - mean) else 0.0
    return changes


@lanes
def _changes(now, farthest):
    """Return whether the error has changed sides; ``farthest`` is NaN before the first side."""
    return (not now * farthest >= 0.0) & (abs(now) >= larger(LEAST, HALF * abs(farthest)))


@lanes
def change_side(Z, lane, row, error, tick, length):
    """Start a new side if the error has changed sides; ``length`` is the control period, s."""
    farthest = Z[row + FARTHEST, lane]
    mean = Z[row + MEAN, lane]
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
    """Store the cycle formed by the last three sides if it is the largest so far."""
    before = Z[row + SWING, lane]
    swing = abs(Z[row + FARTHEST, lane] - Z[row + LAST, lane])
    size = larger(before, swing)
    if before >= HALF * swing and swing >= HALF * before and size > Z[row + LARGEST, lane]:
        Z[row + LARGEST, lane] = size
        Z[row + FREQUENCY, lane] = 1.0 / (
            (Z[row + TICK, lane] - Z[row + FIRST_TICK, lane]) * length
        )
