"""Brent's root finder for compiled functions.

The method is from R. P. Brent, "Algorithms for Minimization without Derivatives" (1973), ch. 4. It
uses inverse quadratic or linear interpolation while this converges, and bisection otherwise; the
root stays bracketed.

Pass only compiled functions at module level, because numba does not cache kernels with closures.
"""

import math
from collections.abc import Callable
from typing import Any

from abhv_mc_vehicle.kernel.jit import scalar

CONVERGED = 0
NO_SIGN_CHANGE = 1
OUT_OF_ITERATIONS = 2
NOT_A_NUMBER = 3  # status if the function returns NaN inside the bracket

_TWO_EPSILON = 4.440892098500626e-16


@scalar
def brent(
    function: Callable[..., float],
    arguments: tuple[Any, ...],
    low: float,
    high: float,
    x_tolerance: float,
    max_iterations: int,
) -> tuple[float, int, int]:
    """Find a zero of ``function(x, *arguments)`` in [low, high].

    Return (root, iterations, status).

    The root is accurate to ``x_tolerance`` (absolute) plus a few rounding errors. ``iterations`` is
    the number of function calls after the two calls at the ends of the interval. If the function
    has the same sign or is NaN at the ends, the root is the end with the smaller residual.
    """
    # b is the best point so far, c the other end of the bracket, and a the previous b.
    # With a single call site, the function is compiled only once.
    a = low
    b = low
    c = low
    fa = 0.0
    fb = 0.0
    fc = 0.0
    step = 0.0
    before = 0.0
    iterations = -2
    while True:
        fb = function(b, *arguments)
        iterations += 1
        if iterations == -1:
            a = low
            fa = fb
            b = high
            continue
        if iterations == 0:
            if fa == 0.0:
                return a, 0, CONVERGED
            if fb == 0.0:
                return b, 0, CONVERGED
            if not ((fa < 0.0 and fb > 0.0) or (fa > 0.0 and fb < 0.0)):
                return (a if abs(fa) < abs(fb) or math.isnan(fb) else b), 0, NO_SIGN_CHANGE
        elif math.isnan(fb):
            return b, iterations, NOT_A_NUMBER
        if iterations == 0 or (fb > 0.0) == (fc > 0.0):
            c = a
            fc = fa
            step = before = b - a

        if abs(fc) < abs(fb):
            a, b, c = b, c, b
            fa, fb, fc = fb, fc, fb
        tolerance = _TWO_EPSILON * abs(b) + 0.5 * x_tolerance
        half = 0.5 * (c - b)
        if abs(half) <= tolerance or fb == 0.0:
            return b, iterations, CONVERGED
        if iterations >= max_iterations:
            return b, iterations, OUT_OF_ITERATIONS

        bisect = abs(before) < tolerance or abs(fa) <= abs(fb)
        if not bisect:
            s = fb / fa
            if a == c:
                p = 2.0 * half * s
                q = 1.0 - s
            else:
                t = fa / fc
                r = fb / fc
                p = s * (2.0 * half * t * (t - r) - (b - a) * (r - 1.0))
                q = (t - 1.0) * (r - 1.0) * (s - 1.0)
            if p > 0.0:
                q = -q
            else:
                p = -p
            # Steps must stay in the bracket and be at most half the step before last.
            bisect = 2.0 * p >= 3.0 * half * q - abs(tolerance * q) or p >= abs(0.5 * before * q)
            if not bisect:
                before = step
                step = p / q
        if bisect:
            step = before = half

        a = b
        fa = fb
        b += step if abs(step) > tolerance else math.copysign(tolerance, half)
