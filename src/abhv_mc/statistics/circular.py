"""Circular quantities, such as angles, made continuous over time and over flights.

Values move only by whole turns, so values that do not cross the seam keep their bits. The period of
a quantity that is not circular is 0.
"""

import numpy as np

from abhv_mc.array_types import Floats

_CONCENTRATED = 0.6  # smallest resultant length of the directions for which a mean exists


def unwrap(values: Floats, period: float) -> Floats:
    """Return values [time] with steps of at most half a turn; missing values are skipped."""
    unwrapped, finite = np.array(values), np.isfinite(values)
    if period:
        unwrapped[finite] = np.unwrap(values[finite], period=period)
    return unwrapped


def move_near(values: Floats, mean: Floats, period: float) -> Floats:
    """Return values moved to within half a turn of ``mean``; NaN where ``mean`` is NaN."""
    # Without "+ 0.0", turns of -0.0 would change the sign of zeros.
    return values - period * (np.round((values - mean) / period) + 0.0)


def align_flights(values: Floats, period: float, count: int | None = None) -> Floats:
    """Return values [flight, time] near their circular mean, which is continuous over time.

    The mean is that of the first ``count`` flights. The result is NaN where these flights spread
    over the circle.
    """
    flights = values[:count]
    number = np.isfinite(flights).sum(axis=0)
    if not period or not number.any():
        return values
    total = np.nansum(np.exp(2j * np.pi / period * flights), axis=0)
    angles = np.angle(total) * period / (2.0 * np.pi)
    mean = unwrap(np.where(np.abs(total) <= _CONCENTRATED * number, np.nan, angles), period)
    first = np.argmax(np.isfinite(mean))
    low, high = (side.reduce(flights[:, first]) for side in (np.fmin, np.fmax))
    # Flights on both sides of a seam, at 0 or half a turn, begin on a turn that does not depend on
    # the selection of flights.
    level = low if high - low < period / 2.0 else period / 4.0
    return move_near(values, mean + period * np.round((level - mean[first]) / period), period)
