"""Notch filter for TLC or LQR.

It takes the first bending mode out of pitch rate and angle of attack.
"""

from typing import NamedTuple

from abhv_mc.extend import Filtered, measurement_filter, sin, sqrt


class Settings(NamedTuple):
    """Frequency, depth and width of the notch.

    Depth and width are the damping ratios of the numerator and the denominator.
    """

    frequency: float = 19.0  # rad/s
    depth: float = 0.1
    width: float = 0.7


class Memory(NamedTuple):
    """Two numbers of each filter."""

    rate_1: float = 0.0
    rate_2: float = 0.0
    alpha_1: float = 0.0
    alpha_2: float = 0.0


def notch(x, first, second, starts, settings, dt):
    """Step the filter (s2 + 2 depth w s + w2) / (s2 + 2 width w s + w2) by one tick.

    The discretization is the bilinear rule, exact at w.
    """
    s = sin(0.5 * settings.frequency * dt)
    k = sqrt(1.0 - s * s) / s
    a0 = k * k + 2.0 * settings.width * k + 1.0
    b0 = (k * k + 2.0 * settings.depth * k + 1.0) / a0
    b1 = 2.0 * (1.0 - k * k) / a0
    b2 = (k * k - 2.0 * settings.depth * k + 1.0) / a0
    a2 = (k * k - 2.0 * settings.width * k + 1.0) / a0
    first = (1.0 - b0) * x if starts else first  # at rest at the first measurement
    second = (b2 - a2) * x if starts else second
    y = b0 * x + first
    return y, b1 * (x - y) + second, b2 * x - a2 * y


@measurement_filter(units={"frequency": "rad/s"})
def law(measured, memory, settings, time, dt):
    """Return the filtered measurement."""
    starts = time == 0.0
    rate, rate_1, rate_2 = notch(
        measured.pitch_rate, memory.rate_1, memory.rate_2, starts, settings, dt
    )
    alpha, alpha_1, alpha_2 = notch(
        measured.angle_of_attack, memory.alpha_1, memory.alpha_2, starts, settings, dt
    )
    filtered = Filtered(pitch_rate=rate, angle_of_attack=alpha)
    return filtered, Memory(rate_1, rate_2, alpha_1, alpha_2)
