"""Lateral motion of an S manoeuvre: speed and acceleration over time."""

import numpy as np

from abhv_mc.array_types import Floats

_CELLS = 4096  # number of integration cells over half the manoeuvre
_SAME_TIME = 1e-9  # tolerance for tick times at the ends of the manoeuvre, s


def s_shape(
    since: Floats, offset: float, length: float, bank_time: float, sharpness: float
) -> tuple[Floats, Floats]:
    """Return lateral speed (m/s) and acceleration (m/s2) at given times (s) since the start.

    Speed and acceleration are zero outside the manoeuvre and positive along ``offset`` (m). The
    acceleration is proportional to ``sign(c) |c|^sharpness`` with ``c = cos(pi t / length)``, times
    a smooth step of order 5 over ``bank_time`` (s) at both ends. If ``bank_time`` and ``sharpness``
    have their defaults, ``y = offset / 2 (1 - cos(pi t / length))``.
    """
    inside = (since >= -_SAME_TIME) & (since < length - _SAME_TIME)
    if bank_time == 0.0 and sharpness == 1.0:
        wave = np.pi / length
        speed = 0.5 * offset * wave * np.sin(wave * since)
        acceleration = 0.5 * offset * wave**2 * np.cos(wave * since)
    else:
        nodes = np.linspace(0.0, 0.5 * length, _CELLS + 1)
        h = nodes[1]
        at_nodes, at_middles = (
            _growth(x, length, bank_time, sharpness) for x in (nodes, nodes[:-1] + 0.5 * h)
        )
        integral = np.concatenate(
            [[0.0], np.cumsum(h / 6.0 * (at_nodes[:-1] + 4.0 * at_middles + at_nodes[1:]))]
        )
        odd, even = integral[1::2].sum(), integral[2:-1:2].sum()
        half = h / 3.0 * (integral[0] + 4.0 * odd + 2.0 * even + integral[-1])
        scale = 0.5 * offset / half
        folded = np.clip(np.minimum(since, length - since), 0.0, 0.5 * length)
        acceleration = np.where(since < 0.5 * length, scale, -scale) * _growth(
            folded, length, bank_time, sharpness
        )
        speed = scale * _between(folded, h, integral, at_nodes)
    return np.where(inside, speed, 0.0), np.where(inside, acceleration, 0.0)


def _growth(since: Floats, length: float, bank_time: float, sharpness: float) -> Floats:
    """Return the acceleration in the manoeuvre's first half, normalized to at most 1."""
    x = np.clip(since / bank_time, 0.0, 1.0) if bank_time else 1.0
    return np.cos(np.pi * since / length).clip(0.0) ** sharpness * (
        x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    )


def _between(x: Floats, h: float, values: Floats, slopes: Floats) -> Floats:
    """Interpolate by cubics from values and slopes at nodes ``0, h, 2 h, ...``."""
    i = np.minimum((x / h).astype(np.int64), values.size - 2)
    t = x / h - i
    rise = values[i + 1] - values[i]
    left = h * slopes[i] - rise
    right = rise - h * slopes[i + 1]
    return values[i] + t * rise + t * (1.0 - t) * ((1.0 - t) * left + t * right)
