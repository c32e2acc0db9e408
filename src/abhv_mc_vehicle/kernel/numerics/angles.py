"""Branch-free scalar functions that wrap angles and limit values."""

import math

from abhv_mc_vehicle.kernel.jit import scalar


@scalar
def wrap(angle):
    """Wrap an angle difference (rad) in [-3 pi, 3 pi] to [-pi, pi]."""
    angle = angle - 2.0 * math.pi if angle > math.pi else angle
    return angle + 2.0 * math.pi if angle < -math.pi else angle


@scalar
def clamp(x, low, high):
    """Limit ``x`` to [low, high]; NaN stays NaN."""
    x = low if x < low else x
    return high if x > high else x


@scalar
def larger(a, b):
    """Return the larger of two numbers, or ``a`` if ``b`` is NaN."""
    return b if b > a else a


@scalar
def smaller(a, b):
    """Return the smaller of two numbers, or ``a`` if ``b`` is NaN."""
    return b if b < a else a
