"""Elementary functions without libm, and functions that wrap angles and limit values.

Without libm and branches, loops over lanes become SIMD code.

A call to libm prevents vectorization; these functions consist of arithmetic, selects and one
bitcast. Errors are at most 2 ulp in the ranges that the docstrings state. Floating point is strict,
without fused multiply-add, so plain Python gives the same bits. Non-finite input follows IEEE
arithmetic and never raises an exception.

Coefficients were fitted by ``tests/reference/fit_lane_math.py``. The argument reductions are from
Cody and Waite, "Software Manual for the Elementary Functions" (1980), ch. 6-8 and 11. The splitting
of log is from Tang, ACM TOMS 16 (1990) 378.
"""

import math
from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.numerics.float_bits import bits_float, float_bits

_EXP = (
    0.5000000000000001,
    0.16666666666666669,
    0.041666666666624164,
    0.008333333333330065,
    0.0013888888917196719,
    0.00019841269863040545,
    2.4801521322368692e-05,
    2.7557268480310024e-06,
    2.7620075879983367e-07,
    2.5100375832561234e-08,
)
_LOG = (
    0.666666666666667,
    0.39999999999899505,
    0.28571428625975487,
    0.2222221113479508,
    0.18182889125261723,
    0.15331721600556042,
    0.14616449685043406,
)
SIN = (
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836758574,
    2.755731610255244e-06,
    -2.5051131845003624e-08,
    1.5918129294866608e-10,
)
COS = (
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876569e-05,
    -2.7557317271729793e-07,
    2.08761462684032e-09,
    -1.1382632425521717e-11,
)
_ATAN = (
    -0.3333333333333333,
    0.1999999999999552,
    -0.14285714284666542,
    0.11111111015256361,
    -0.09090904578123903,
    0.07692183190826087,
    -0.06664511447381948,
    0.0585814891280221,
    -0.0508544973794026,
    0.03923165829558719,
    -0.01917688711906226,
)
# Each constant is a sum of terms whose products with the small integers of a reduction are exact.
_LN2 = (0.6931471803691238, 1.9082149292705877e-10)
HALF_PI = (1.5707963267341256, 6.077100506303966e-11, 2.0222662487959506e-21)

_LOG2_E = 1.4426950408889634
_TWO_OVER_PI = 0.6366197723675814
_PI = 3.141592653589793
_PI_LOW = 1.2246467991473532e-16
TAN_EIGHTH_PI = 0.41421356237309503

# Adding 1.5 * 2^52 to a number rounds it to an integer, which is in the low bits of the sum.
_ROUND = 6755399441055744.0
_ROUND_BITS = 0x4338000000000000
_MANTISSA = 0x000FFFFFFFFFFFFF
# bits of a number just below sqrt(1/2); reduced mantissas range from sqrt(1/2) to sqrt(2)
_BITS_SQRT_HALF = 0x3FE6A09E00000000
_BITS_TO_ONE = 0x3FF0000000000000 - _BITS_SQRT_HALF

SINCOS_LIMIT = 1048576.0  # largest magnitude for an exact reduction, rad; NaN beyond it


@scalar
def exp(x: float) -> float:
    """Return the exponential, with gradual underflow; 0 or inf outside the range of doubles."""
    low = -746.0 if x < -746.0 else x
    high = low if low < 710.0 else 710.0  # NaN becomes 710 here and is restored by r.
    rounded = high * _LOG2_E + _ROUND
    k = rounded - _ROUND
    r = (low - k * _LN2[0]) - k * _LN2[1]
    r2 = r * r
    r4 = r2 * r2
    p01 = _EXP[0] + _EXP[1] * r
    p23 = _EXP[2] + _EXP[3] * r
    p45 = _EXP[4] + _EXP[5] * r
    p67 = _EXP[6] + _EXP[7] * r
    p89 = _EXP[8] + _EXP[9] * r
    q = (p01 + p23 * r2) + r4 * ((p45 + p67 * r2) + r4 * p89)
    value = 1.0 + (r + r2 * q)
    # 2^k is split into two factors, so that k = 1024 and subnormal results are correct.
    integer = float_bits(rounded) - _ROUND_BITS
    half = integer >> 1
    return value * bits_float((half + 1023) << 52) * bits_float((integer - half + 1023) << 52)


@scalar
def log(x: float) -> float:
    """Return the natural logarithm; -inf at 0 and NaN for negative numbers."""
    subnormal = x < 2.2250738585072014e-308
    scaled = x * 18014398509481984.0 if subnormal else x  # The factor is 2^54.
    bits = float_bits(scaled) + _BITS_TO_ONE
    e = bits_float((bits >> 52) - 1023 + _ROUND_BITS) - _ROUND
    e = e - 54.0 if subnormal else e
    f = bits_float((bits & _MANTISSA) + _BITS_SQRT_HALF) - 1.0
    s = f / (2.0 + f)
    z = s * s
    z2 = z * z
    odd = _LOG[0] + z * _LOG[1]
    middle = _LOG[2] + z * _LOG[3]
    last = _LOG[4] + z * (_LOG[5] + z * _LOG[6])
    r = z * (odd + z2 * (middle + z2 * last))
    half_f2 = 0.5 * f * f
    # f is added last, because rounding errors of the smaller terms are smaller; 2 s = f - s f.
    value = e * _LN2[0] - ((half_f2 - (s * (half_f2 + r) + e * _LN2[1])) - f)
    value = value if x < math.inf else x  # Infinity and NaN pass through.
    value = value if x != 0.0 else -math.inf
    return math.nan if x < 0.0 else value


@scalar
def power(x: float, y: float) -> float:
    """Return a power of positive x as exp(y log x), with a relative error of 1e-16 |y log x|."""
    return exp(y * log(x))


@scalar
def sincos(x: float) -> tuple[float, float]:
    """Return (sin x, cos x) for x in radians, abs(x) up to :data:`SINCOS_LIMIT`."""
    rounded = x * _TWO_OVER_PI + _ROUND
    n = rounded - _ROUND
    quadrant = float_bits(rounded) & 3
    # The reduced angle x - n pi/2 is r + tail. Two of the products are exact, and tail includes the
    # rounding error of the second sum.
    a = x - n * HALF_PI[0]
    b = -(n * HALF_PI[1])
    c = a + b
    increment = c - a
    tail = ((a - (c - increment)) + (b - increment)) - n * HALF_PI[2]
    r = c + tail
    tail = (c - r) + tail

    z = r * r
    z2 = z * z
    half_z = 0.5 * z
    s = (SIN[1] + z * SIN[2]) + z2 * ((SIN[3] + z * SIN[4]) + z2 * SIN[5])
    r3 = z * r
    sine = r - ((z * (0.5 * tail - r3 * s) - tail) - r3 * SIN[0])
    c = (COS[0] + z * COS[1]) + z2 * ((COS[2] + z * COS[3]) + z2 * (COS[4] + z * COS[5]))
    w = 1.0 - half_z
    cosine = w + (((1.0 - w) - half_z) + (z2 * c - r * tail))

    swap = (quadrant & 1) != 0
    sin_x = cosine if swap else sine
    cos_x = sine if swap else cosine
    sin_x = -sin_x if (quadrant & 2) != 0 else sin_x
    cos_x = -cos_x if ((quadrant + 1) & 2) != 0 else cos_x
    valid = abs(x) <= SINCOS_LIMIT
    return (sin_x if valid else math.nan), (cos_x if valid else math.nan)


@scalar
def tan(x: float) -> float:
    """Return the tangent for x in radians, abs(x) up to :data:`SINCOS_LIMIT`."""
    sin_x, cos_x = sincos(x)
    return sin_x / cos_x


@scalar
def reciprocals(a: float, b: float) -> tuple[float, float]:
    """Return (1 / a, 1 / b) within 1.5 ulp, with one division.

    If ``a b`` is 0 or outside the range of doubles, the result is not finite or is 0.
    """
    inverse = 1.0 / (a * b)
    return b * inverse, a * inverse


class Octant(NamedTuple):
    """Angle as a multiple of pi/4 plus or minus the arc tangent of a quotient <= tan(pi/8)."""

    numerator: float
    denominator: float
    quarters: float
    falls: bool  # whether the arc tangent is subtracted


@scalar
def octant_of(y: float, x: float) -> Octant:
    """Return the octant of the point (x, abs(y))."""
    abs_x = abs(x)
    abs_y = abs(y)
    steep = abs_y > abs_x
    small = abs_x if steep else abs_y
    large = abs_y if steep else abs_x
    # Above pi/8, atan(a/b) = pi/4 + atan((a - b) / (a + b)); both cases share one division.
    upper = small > TAN_EIGHTH_PI * large
    numerator = small - large if upper else small
    denominator = small + large if upper else large
    left = float_bits(x) < 0
    quarters = 2.0 if steep else (4.0 if left else 0.0)
    falls = steep != left
    quarters = quarters + ((-1.0 if falls else 1.0) if upper else 0.0)
    return Octant(numerator, denominator if denominator != 0.0 else 1.0, quarters, falls)


@scalar
def atan_excess(u: float) -> float:
    """Return atan u - u for abs(u) up to tan(pi/8)."""
    z = u * u
    z2 = z * z
    z4 = z2 * z2
    p01 = _ATAN[0] + z * _ATAN[1]
    p23 = _ATAN[2] + z * _ATAN[3]
    p45 = _ATAN[4] + z * _ATAN[5]
    p67 = _ATAN[6] + z * _ATAN[7]
    p8 = _ATAN[8] + z * (_ATAN[9] + z * _ATAN[10])
    q = (p01 + z2 * p23) + z4 * ((p45 + z2 * p67) + z4 * p8)
    return u * z * q


@scalar
def angle_in(octant: Octant, u: float, y: float) -> float:
    """Return the angle of a point from its octant and quotient ``u``, with the sign of y."""
    excess = atan_excess(u)
    u = -u if octant.falls else u
    excess = -excess if octant.falls else excess
    angle = octant.quarters * (0.25 * _PI) + (u + (excess + octant.quarters * (0.25 * _PI_LOW)))
    return -angle if float_bits(y) < 0 else angle


@scalar
def atan2(y: float, x: float) -> float:
    """Return the angle of (x, y) in (-pi, pi], with signed zeros; NaN if both are infinite."""
    octant = octant_of(y, x)
    return angle_in(octant, octant.numerator / octant.denominator, y)


@scalar
def is_shallow(y: float, x: float) -> bool:
    """Return whether the point (x, y) is within pi/8 of the positive x axis."""
    return abs(y) <= TAN_EIGHTH_PI * x


@scalar
def shallow_angles(y_1: float, x_1: float, y_2: float, x_2: float) -> tuple[float, float]:
    """Return the same bits as :func:`two_angles` for shallow points, at a third of the cost."""
    per_x_1, per_x_2 = reciprocals(x_1, x_2)
    u_1 = y_1 * per_x_1
    u_2 = y_2 * per_x_2
    angle_1 = u_1 + atan_excess(u_1)
    angle_2 = u_2 + atan_excess(u_2)
    return (angle_1 if u_1 != 0.0 else u_1), (angle_2 if u_2 != 0.0 else u_2)  # -0.0 is preserved.


@scalar
def two_angles(y_1: float, x_1: float, y_2: float, x_2: float) -> tuple[float, float]:
    """Return ``atan2`` of two points near the unit circle, within 4 ulp, with one division."""
    first = octant_of(y_1, x_1)
    second = octant_of(y_2, x_2)
    per_first, per_second = reciprocals(first.denominator, second.denominator)
    return angle_in(first, first.numerator * per_first, y_1), angle_in(
        second, second.numerator * per_second, y_2
    )


@scalar
def asin(x: float) -> float:
    """Return the arc sine; arguments are clipped to [-1, 1] to allow for rounding errors."""
    x = 1.0 if x > 1.0 else x
    x = -1.0 if x < -1.0 else x
    return atan2(x, math.sqrt((1.0 - x) * (1.0 + x)))


@scalar
def acos(x: float) -> float:
    """Return the arc cosine; arguments are clipped to [-1, 1] to allow for rounding errors."""
    x = 1.0 if x > 1.0 else x
    x = -1.0 if x < -1.0 else x
    return atan2(math.sqrt((1.0 - x) * (1.0 + x)), x)


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
