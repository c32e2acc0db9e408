"""Crossings and peaks over frequency of many loops at once: bracketed on a grid, then refined together."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from abhv_mc.vehicle.arrays import Floats, Ints

_CROSSING_STEPS = 40
_PEAK_STEPS = 24
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

# A quantity [point] of loops [point] at frequencies [point], rad/s.
Quantity = Callable[[Ints, Floats], Floats]


def changes_of_sign(values: Floats) -> tuple[Ints, Ints]:
    """Loop and interval [crossing] in which ``values`` [loop, frequency] change their sign."""
    positive = values > 0.0
    loop, interval = np.nonzero(positive[:, 1:] != positive[:, :-1])
    return loop, interval


def refine_crossings(quantity: Quantity, values: Floats, omega: Floats, loop: Ints, interval: Ints) -> Floats:
    """Frequencies [crossing] of the zeros in the intervals of the grid ``omega`` [loop, frequency].

    Anderson and Bjorck's false position in the logarithm of the frequency, halving where that is slow.
    """
    a, b = np.log(omega[loop, interval]), np.log(omega[loop, interval + 1])
    fa, fb = values[loop, interval].copy(), values[loop, interval + 1].copy()
    end = b.copy()
    busy = np.arange(loop.size)
    for step in range(_CROSSING_STEPS):
        if busy.size == 0:
            break
        c = b[busy] - fb[busy] * (b[busy] - a[busy]) / (fb[busy] - fa[busy])
        if step % 3 == 2:
            c = 0.5 * (a[busy] + b[busy])
        fc = quantity(loop[busy], np.exp(c))
        same = (fc > 0.0) == (fb[busy] > 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = 1.0 - fc / fb[busy]
        share = np.where(share > 0.0, share, 0.5)
        fa[busy] = np.where(same, fa[busy] * share, fb[busy])
        a[busy] = np.where(same, a[busy], b[busy])
        moved = np.abs(c - end[busy])
        b[busy], fb[busy], end[busy] = c, fc, c
        busy = busy[(np.minimum(moved, np.abs(c - a[busy])) > 1e-13) & (fc != 0.0)]
    return np.asarray(np.exp(end))


def refine_peaks(quantity: Quantity, omega: Floats, at: Ints, value: Floats) -> tuple[Floats, Floats]:
    """Largest value [loop] near the grid's ``at`` [loop], where it is ``value``, and its frequency.

    Golden section between the neighbours in the grid ``omega`` [loop, frequency].
    """
    loops = np.arange(len(omega))
    last = omega.shape[1] - 1
    low = np.log(omega[loops, np.maximum(at - 1, 0)])
    high = np.log(omega[loops, np.minimum(at + 1, last)])
    best, where = value.copy(), omega[loops, at].copy()

    def ask(x: Floats) -> Floats:
        found = quantity(loops, np.exp(x))
        better = found > best
        best[better], where[better] = found[better], np.exp(x)[better]
        return found

    left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    f_left, f_right = ask(left), ask(right)
    for _ in range(_PEAK_STEPS):
        rising = f_left < f_right
        low, high = np.where(rising, left, low), np.where(rising, high, right)
        fresh = np.where(rising, low + _GOLDEN * (high - low), high - _GOLDEN * (high - low))
        f_fresh = ask(fresh)
        left, right = np.where(rising, right, fresh), np.where(rising, fresh, left)
        f_left, f_right = np.where(rising, f_right, f_fresh), np.where(rising, f_fresh, f_left)
    return best, where


def frequency_grid(poles: list[NDArray[np.complex128]], period: float, count: int) -> Floats:
    """Frequencies [system, frequency], rad/s: evenly in the logarithm up to half the sampling rate.

    The systems' own oscillating ``poles`` (discrete) are among them, where their responses may have narrow peaks.
    """
    own = count // 5
    top = np.pi / period
    base = np.geomspace(1e-4, top, count - own)
    grid = np.empty((len(poles), count))
    for i, each in enumerate(poles):
        with np.errstate(divide="ignore"):
            s = np.log(each.astype(np.complex128)) / period
        slow = s[(s.imag > 1e-3) & (s.imag < 0.999 * top)]
        chosen = slow[np.argsort(np.abs(slow.real) / slow.imag)][:own].imag
        grid[i] = np.sort(np.concatenate([base, chosen, np.full(own - chosen.size, top)]))
    return grid
