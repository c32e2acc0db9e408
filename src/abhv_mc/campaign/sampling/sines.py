"""Sine and cosine with the bits of the compiled code, on every processor.

The method and the constants are those of :func:`abhv_mc_vehicle.kernel.numerics.lane_math.sincos`.
"""

import numpy as np

from abhv_mc.array_types import Floats

_SIN = (
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836758574,
    2.755731610255244e-06,
    -2.5051131845003624e-08,
    1.5918129294866608e-10,
)
_COS = (
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876569e-05,
    -2.7557317271729793e-07,
    2.08761462684032e-09,
    -1.1382632425521717e-11,
)
_HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)
_TWO_OVER_PI = 0.6366197723675814
_ROUND = 6755399441055744.0  # Adding 1.5 * 2^52 rounds a number to an integer.
_LIMIT = 1048576.0  # largest magnitude for an exact reduction, rad


def sine(x: Floats, quarter: int = 0) -> Floats:
    """Return the sine of x + ``quarter`` pi/2; NaN for magnitudes of x beyond 2^20 rad."""
    x = np.where(np.abs(x) <= _LIMIT, x, np.nan)
    n = (x * _TWO_OVER_PI + _ROUND) - _ROUND
    a, b = x - n * _HALF_PI[0], -(n * _HALF_PI[1])
    c = a + b
    increment = c - a
    tail = ((a - (c - increment)) + (b - increment)) - n * _HALF_PI[2]
    r = c + tail
    tail = (c - r) + tail
    z = r * r
    z2, half_z, r3 = z * z, 0.5 * z, z * r
    s = (_SIN[1] + z * _SIN[2]) + z2 * ((_SIN[3] + z * _SIN[4]) + z2 * _SIN[5])
    of_sine = r - ((z * (0.5 * tail - r3 * s) - tail) - r3 * _SIN[0])
    c = (_COS[0] + z * _COS[1]) + z2 * ((_COS[2] + z * _COS[3]) + z2 * (_COS[4] + z * _COS[5]))
    w = 1.0 - half_z
    of_cosine = w + (((1.0 - w) - half_z) + (z2 * c - r * tail))
    quadrant = (np.nan_to_num(n).astype(np.int64) + quarter) & 3
    values = np.where(quadrant & 1, of_cosine, of_sine)
    return np.asarray(np.where(quadrant & 2, -values, values), dtype=np.float64)
