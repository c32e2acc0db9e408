"""Vectorized search for zero crossings and peaks over frequency."""

from collections.abc import Callable

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints, Mask

_CROSSING_STEPS = 40
_PEAK_STEPS = 9
_SECTION = 0.5 * (3.0 - np.sqrt(5.0))  # golden-section ratio
# tolerance of the quantity at a zero crossing, and of the logarithm of the frequency
_CLOSE = 1e-12

# function of loop indices and frequencies (rad/s) that returns a quantity [point]
Quantity = Callable[[Ints, Floats], Floats]


def refine_crossings(
    quantity: Quantity, values: Floats, omega: Floats, loop: Ints, interval: Ints
) -> Floats:
    """Return the frequencies [crossing] of zeros in intervals of `omega` [loop, frequency].

    The method of Anderson and Bjorck is used, with bisection in every third step.
    """
    a = np.log(omega[loop, interval])
    b = np.log(omega[loop, interval + 1])
    fa = values[loop, interval].copy()
    fb = values[loop, interval + 1].copy()
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
        b[busy] = c
        fb[busy] = fc
        end[busy] = c
        busy = busy[(np.minimum(moved, np.abs(c - a[busy])) > _CLOSE) & (np.abs(fc) > _CLOSE)]
    return np.exp(end)


def refine_peaks(
    quantity: Quantity, omega: Floats, start: Ints, value: Floats
) -> tuple[Floats, Floats]:
    """Return the maximum [loop] near grid index `start` [loop], and its frequency.

    Steps use parabolas, with a golden section in every third step.
    """
    loops = np.arange(len(omega))
    x = np.log(omega)
    low, middle, high = (
        x[loops, np.clip(start + step, 0, omega.shape[1] - 1)] for step in (-1, 0, 1)
    )
    f_middle = value.copy()
    f_low, f_high = (quantity(loops, np.exp(end)) for end in (low, high))
    for step in range(_PEAK_STEPS):
        left = middle - low
        right = high - middle
        longer = np.where(right > left, middle + _SECTION * right, middle - _SECTION * left)
        with np.errstate(divide="ignore", invalid="ignore"):
            p = right * (f_middle - f_low)
            q = left * (f_middle - f_high)
            vertex = middle + 0.5 * (right * p - left * q) / (p + q)
        far = np.minimum(np.abs(vertex - low), np.abs(vertex - high)) > 0.0
        useful = np.isfinite(vertex) & (vertex > low) & (vertex < high) & (vertex != middle) & far
        new = np.where(useful & (step % 3 != 2), vertex, longer)
        f_new = quantity(loops, np.exp(new))
        better = f_new > f_middle
        after = new > middle
        low, f_low = _choose(
            better & after, middle, f_middle, ~better & ~after, new, fb=f_new, x=low, f=f_low
        )
        high, f_high = _choose(
            better & ~after, middle, f_middle, ~better & after, new, fb=f_new, x=high, f=f_high
        )
        middle = np.where(better, new, middle)
        f_middle = np.where(better, f_new, f_middle)
    return f_middle, np.exp(middle)


def _choose(  # If both masks are set, the first mask is used.
    a: Mask, xa: Floats, fa: Floats, b: Mask, xb: Floats, *, fb: Floats, x: Floats, f: Floats
) -> tuple[Floats, Floats]:
    return np.where(a, xa, np.where(b, xb, x)), np.where(a, fa, np.where(b, fb, f))


def frequency_grid(poles: list[Complexes], period: float, count: int) -> Floats:
    """Return a logarithmic grid [system, frequency], rad/s, including pole frequencies."""
    own = count // 10
    top = np.pi / period
    base = np.geomspace(1e-4, top, count - own)
    grid = np.empty((len(poles), count))
    for i, system_poles in enumerate(poles):
        s = np.log(system_poles[system_poles != 0.0].astype(np.complex128)) / period
        slow = s[(s.imag > 1e-3) & (s.imag < 0.999 * top)]
        chosen = slow[np.argsort(np.abs(slow.real) / slow.imag)][:own].imag
        spare = np.geomspace(0.1, 100.0, own - chosen.size)  # typical crossover frequencies, rad/s
        grid[i] = np.sort(np.concatenate([base, chosen, np.minimum(spare, top)]))
    return grid
