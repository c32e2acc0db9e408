"""Fit the polynomials of ``kernel.numerics.lane_math`` with 60 digits and print them.

Each is the interpolant at Chebyshev nodes of a smooth function, within a small factor of minimax;
the degrees are chosen so that the truncation error is far below half a unit in the last place. Run
it to reproduce the constants.
"""

from mpmath import atan, atanh, chebyfit, cos, expm1, floor, ldexp, log, mp, pi, sin, sqrt, tan

mp.dps = 60


def split(value, bits):
    """Split a constant into a sum of doubles.

    All but the last are truncated to the given number of bits.
    """
    parts = []
    for count in bits:
        step = ldexp(1, int(floor(log(value, 2))) + 1 - count)
        parts.append(float(floor(value / step) * step))
        value -= parts[-1]
    return (*parts, float(value))


def of_root(series):
    """A function of z, its series written for the square root of z."""
    return lambda z: series(sqrt(z))


S_MAX = (sqrt(2) - 1) / (sqrt(2) + 1)
FITTED = {  # function, interval, degree
    "EXP": (
        lambda r: (expm1(r) - r) / r**2,
        (-log(2) / 2, log(2) / 2),
        9,
    ),  # e^r = 1 + r + r^2 P(r)
    "LOG": (
        of_root(lambda s: 2 * (atanh(s) - s) / s**3),
        (0, S_MAX**2),
        6,
    ),  # log((1+s)/(1-s)) = 2 s + s z R(z)
    "SIN": (
        of_root(lambda r: (sin(r) - r) / r**3),
        (0, (pi / 4) ** 2),
        5,
    ),  # sin r = r + r z S(z), z = r^2
    "COS": (
        of_root(lambda r: (cos(r) - 1 + r**2 / 2) / r**4),
        (0, (pi / 4) ** 2),
        5,
    ),  # cos r = 1 - z/2 + z^2 C(z)
    "ATAN": (
        of_root(lambda u: (atan(u) - u) / u**3),
        (0, tan(pi / 8) ** 2),
        10,
    ),  # atan u = u + u z A(z)
}


def fit():
    """Return all fitted constants of the module by name.

    Coefficients start with the constant and are rounded to doubles.
    """
    fitted = {
        name: chebyfit(f, ends, degree + 1)[::-1] for name, (f, ends, degree) in FITTED.items()
    }
    return {
        **{name: tuple(map(float, coefficients)) for name, coefficients in fitted.items()},
        "LN2": split(log(2), (32,)),
        "HALF_PI": split(pi / 2, (33, 33)),
    }


if __name__ == "__main__":
    for name, values in fit().items():
        print(f"{name} = {values}")
