"""Random numbers for flights: L'Ecuyer's MRG32k3a, whose arithmetic is exact in doubles.

The generator is from P. L'Ecuyer, "Good parameters and implementations for combined multiple
recursive random number generators", Operations Research 47 (1999) 159. The functions use no
integers, and return the same bits in compiled code, in groups of lanes and in plain Python.
"""

import math

from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import log, sincos

M1 = 4294967087.0
M2 = 4294944443.0
_INVERSE_M1 = 1.0 / M1
_INVERSE_M2 = 1.0 / M2
_NORM = 2.328306549295728e-10  # normalization, 1 / (m1 + 1)
_ROUND = 6755399441055744.0  # Adding and subtracting this number rounds to an integer.
_GOLDEN = 0.6180339887498949

N_STREAM_ROWS = 6  # number of rows of a stream's state in the lane memory


@scalar
def modulo(x, m, inverse_m):
    """Return ``x`` modulo ``m`` in 0..m-1, exact for integers below 2^53."""
    k = (x * inverse_m + _ROUND) - _ROUND
    r = x - k * m
    return r + m if r < 0.0 else r


@scalar
def seed_word(seed, number, m):
    """Return word ``number`` of the initial state, a value 1..m-1, for a seed in [0, 1)."""
    x = (seed + 0.137) * (number + 1.0) * 7919.0 + _GOLDEN * number
    fraction = x - ((x + _ROUND) - _ROUND)
    fraction = fraction + 1.0 if fraction < 0.0 else fraction
    # ``fine`` gives different states to seeds that differ only in their last bits.
    fine = fraction * 1048576.0
    fine -= (fine + _ROUND) - _ROUND
    word = (fraction + fine * 0.25 + 0.25) * 0.6 * m
    return ((word + _ROUND) - _ROUND) + 1.0


@scalar
def next_uniform(s0, s1, s2, s3, s4, s5):
    """Return a uniform number in (0, 1), and the six words of the next state."""
    p1 = modulo(1403580.0 * s1 - 810728.0 * s0, M1, _INVERSE_M1)
    p2 = modulo(527612.0 * s5 - 1370589.0 * s3, M2, _INVERSE_M2)
    difference = p1 - p2
    u = (difference if difference > 0.0 else difference + M1) * _NORM
    return u, s1, s2, p1, s4, s5, p2


@scalar
def normal_pair(u1, u2):
    """Return two standard normal numbers from two uniform numbers (Box and Muller 1958)."""
    radius = math.sqrt(-2.0 * log(u1))
    sine, cosine = sincos(2.0 * math.pi * u2)
    return radius * cosine, radius * sine
