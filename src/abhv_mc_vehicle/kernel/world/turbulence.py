"""Gusts of MIL-F-8785C: 1-cosine gust, and exactly discretized Dryden turbulence."""

import math

from abhv_mc_vehicle.kernel.jit import scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import exp, log, sincos

# number of filter states: one longitudinal, two lateral, two vertical, one roll, and one lagged
# state each of the lateral and the vertical gust
N_FILTER_STATES = 8

_ROOT3 = math.sqrt(3.0)
_THIRD = 1.0 / 3.0


@scalar
def one_minus_cosine(distance, length):
    """Return the fraction 0..1 of the gust amplitude at a ``distance`` (m) into the gust.

    ``length`` (m) is half a wavelength.
    """
    x = distance / length
    x = 0.0 if x < 0.0 else x
    x = 1.0 if x > 1.0 else x
    _, cosine = sincos(math.pi * x)
    return 0.5 * (1.0 - cosine)


@scalar
def dryden_first(x, a, dt, noise):
    """Return the next state of the longitudinal filter of unit variance.

    The spectrum is 2 / (a pi) 1 / (1 + (w / a)^2) with a = V / L.
    """
    e = exp(-a * dt)
    return e * x + math.sqrt(1.0 - e * e) * noise


@scalar
def dryden_second(x1, x2, a, dt, noise1, noise2, first):
    """Return the next states of the lateral or vertical filter, driven by unit white noise w.

    The states obey x1' = -a x1 + w and x2' = -a x2 + x1. At the ``first`` tick they are drawn from
    the filter's stationary distribution.
    """
    s11 = math.sqrt(0.5 / a)
    s21 = 0.25 / (a * a * s11)
    variance = 0.25 / (a * a * a) - s21 * s21
    start1 = s11 * noise1
    start2 = s21 * noise1 + math.sqrt(variance if variance > 0.0 else 0.0) * noise2
    e = exp(-a * dt)
    e2 = e * e
    t = a * dt
    q11 = (1.0 - e2) / (2.0 * a)
    q12 = (1.0 - e2 * (1.0 + 2.0 * t)) / (4.0 * a * a)
    q22 = (1.0 - e2 * (1.0 + 2.0 * t + 2.0 * t * t)) / (4.0 * a * a * a)
    l11 = math.sqrt(q11)
    l21 = q12 / l11
    variance = q22 - l21 * l21
    l22 = math.sqrt(variance if variance > 0.0 else 0.0)
    next1 = e * x1 + l11 * noise1
    next2 = e * (x2 + dt * x1) + l21 * noise1 + l22 * noise2
    return (start1 if first else next1), (start2 if first else next2)


@scalar
def dryden_second_output(x1, x2, a):
    """Return the gust velocity, of unit variance, from the filter states.

    The spectrum is 1 / (a pi) (1 + 3 (w / a)^2) / (1 + (w / a)^2)^2.
    """
    return (_ROOT3 * a * x1 + a * a * (1.0 - _ROOT3) * x2) / math.sqrt(a)


@scalar
def roll_gust_sigma(length, span):
    """Return the rms of the roll gust, rad/s, for a vertical gust of 1 m/s rms.

    The spectrum is 0.8 (pi L / 4 b)^(1/3) / (L V (1 + (4 b w / pi V)^2)) for w > 0, with span b (m)
    and length L (m).
    """
    return math.sqrt(
        0.8
        * exp(_THIRD * log(math.pi * length / (4.0 * span)))
        * math.pi**2
        / (8.0 * span * length)
    )


@scalar
def follow(late, value, rate, dt):
    """Return the output of a first-order lag after time ``dt`` with a constant input."""
    return value + exp(-rate * dt) * (late - value)
