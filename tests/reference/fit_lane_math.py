"""Fit the polynomials of ``abhv_mc.kernel.numerics.lane_math`` with 60 digits and print them.

Each is the interpolant at Chebyshev nodes of a smooth function, within a small factor of minimax; the degrees are
chosen so that the truncation error is far below half a unit in the last place. Run it to reproduce the constants.
"""

from collections.abc import Callable

import mpmath

mpmath.mp.dps = 60
mpf = mpmath.mpf


def interpolate(function: Callable[[mpf], mpf], low: mpf, high: mpf, degree: int) -> tuple[float, ...]:
    """Coefficients, constant first, rounded to doubles, of the Chebyshev interpolant on [low, high]."""
    n = degree + 1
    nodes = [(low + high) / 2 + (high - low) / 2 * mpmath.cos(mpmath.pi * (2 * i + 1) / (2 * n)) for i in range(n)]
    vandermonde = mpmath.matrix(n, n)
    for i, x in enumerate(nodes):
        for j in range(n):
            vandermonde[i, j] = x**j
    solution = mpmath.lu_solve(vandermonde, mpmath.matrix([function(x) for x in nodes]))
    return tuple(float(c) for c in solution)


def split(value: mpf, bits: tuple[int, ...]) -> tuple[float, ...]:
    """A constant as a sum of doubles: the first parts truncated to the given number of bits, then the rest."""
    parts = []
    for count in bits:
        step = mpmath.ldexp(1, int(mpmath.floor(mpmath.log(value, 2))) + 1 - count)
        part = mpmath.floor(value / step) * step
        parts.append(float(part))
        value -= part
    return (*parts, float(value))


def _exp(r: mpf) -> mpf:  # (e^r - 1 - r) / r^2
    return (mpmath.expm1(r) - r) / r**2


def _log(z: mpf) -> mpf:  # log((1+s)/(1-s)) = 2 s + s z R(z), z = s^2
    s = mpmath.sqrt(z)
    return (2 * mpmath.atanh(s) - 2 * s) / (s * z)


def _sin(z: mpf) -> mpf:  # sin r = r + r z S(z), z = r^2
    r = mpmath.sqrt(z)
    return (mpmath.sin(r) - r) / (r * z)


def _cos(z: mpf) -> mpf:  # cos r = 1 - z/2 + z^2 C(z)
    return (mpmath.cos(mpmath.sqrt(z)) - 1 + z / 2) / z**2


def _atan(z: mpf) -> mpf:  # atan u = u + u z A(z), z = u^2
    u = mpmath.sqrt(z)
    return (mpmath.atan(u) - u) / (u * z)


def fit() -> dict[str, tuple[float, ...]]:
    """All fitted constants of the module by name."""
    half_ln2 = mpmath.log(2) / 2
    s_max = mpmath.sqrt(2) - 1
    s_max = s_max / (s_max + 2)
    return {
        "EXP": interpolate(_exp, -half_ln2, half_ln2, 9),
        "LOG": interpolate(_log, mpf(0), s_max**2, 6),
        "SIN": interpolate(_sin, mpf(0), (mpmath.pi / 4) ** 2, 5),
        "COS": interpolate(_cos, mpf(0), (mpmath.pi / 4) ** 2, 5),
        "ATAN": interpolate(_atan, mpf(0), mpmath.tan(mpmath.pi / 8) ** 2, 10),
        "LN2": split(mpmath.log(2), (32,)),
        "HALF_PI": split(mpmath.pi / 2, (33, 33)),
    }


if __name__ == "__main__":
    for name, values in fit().items():
        print(f"{name} = (")
        for value in values:
            print(f"    {value!r},")
        print(")")
