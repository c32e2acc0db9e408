"""Operators of signal temporal logic on the samples of a flight.

Intervals are cut at the last sample: beyond it, nothing is true.
"""

import numpy as np

from abhv_mc.array_types import Floats


def _shift(values: Floats, samples: int) -> Floats:
    """Return the values ``samples`` ahead of each sample, and -inf beyond the last one."""
    return np.append(values[samples:], np.full(min(samples, values.size), -np.inf))


def find_maximum(values: Floats, first: int, last: float) -> Floats:
    """Return the maximum of the values from ``first`` to ``last`` samples ahead of each sample.

    The result is NaN if a value is NaN.
    """
    from scipy.ndimage import maximum_filter1d

    size = int(min(last, values.size - 1)) - first + 1
    if size <= 0 or np.isnan(values).any():
        return np.full(values.size, -np.inf if size <= 0 else np.nan)
    origin = -(size // 2)
    ahead = maximum_filter1d(values, size, mode="constant", cval=-np.inf, origin=origin)
    return _shift(ahead, first)


def find_minimum(values: Floats, first: int, last: float) -> Floats:
    """Return the minimum of the values, like :func:`find_maximum`."""
    return -find_maximum(-values, first, last)


def find_until(before: Floats, target: Floats, first: int, last: float) -> Floats:
    """Return the robustness of ``before`` until ``target``, by doubling numbers of samples.

    The interval is treated as by Donze, Ferrere and Maler (2013).
    """
    held, reached, samples = before, target, 1
    while samples < target.size:
        reached = np.maximum(reached, np.minimum(held, _shift(reached, samples)))
        held = np.minimum(held, _shift(held, samples))
        samples *= 2
    wait = find_minimum(before, 0, first - 1)
    return np.minimum.reduce([wait, _shift(reached, first), find_maximum(target, first, last)])


def find_steps(values: Floats) -> Floats:
    """Return inf at the last sample of each step or ramp of a signal, and -inf elsewhere.

    Changes below 1e-9 of the range are rounding errors.
    """
    changes = np.abs(np.diff(values, prepend=values[:1])) > 1e-9 * np.ptp(values)
    return np.where(changes & ~np.append(changes[1:], False), np.inf, -np.inf)
