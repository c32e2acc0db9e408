"""Angles and limits as select-only scalar functions."""

import math

from abhv_mc.kernel.jit import scalar


@scalar
def wrap(angle):
    """An angle difference, rad, brought into [-pi, pi] from [-3 pi, 3 pi]."""
    angle = angle - 2.0 * math.pi if angle > math.pi else angle
    return angle + 2.0 * math.pi if angle < -math.pi else angle


@scalar
def clamp(x, low, high):
    """``x`` limited to [low, high]; NaN stays NaN."""
    x = low if x < low else x
    return high if x > high else x


@scalar
def larger(a, b):
    """The larger of two numbers; the first where the second is not a number."""
    return b if b > a else a


@scalar
def smaller(a, b):
    """The smaller of two numbers; the first where the second is not a number."""
    return b if b < a else a
