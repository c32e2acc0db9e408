"""Cases with known failure probabilities.

Severities are functions of standard normal points, with a formula or an integral.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import integrate, special, stats


@dataclass(frozen=True)
class Case:
    """A severity, its dimension, and P(severity > threshold)."""

    name: str
    dimension: int
    severity: Callable[..., np.ndarray]  # of points, and of switches where there are any
    threshold: float
    probability: float
    rates: np.ndarray | None = None  # of switches


def switched(number, rate, limit, step=0.0, fatal=99):
    """Severity of u1 above a limit that each switch lowers by ``step``.

    ``fatal`` switches together always fail.
    """

    def severity(u, on):
        count = on.sum(axis=1)
        return np.where(count >= fatal, 1.0, u[:, 0] - limit + step * count)

    shares = stats.binom.pmf(np.arange(number + 1), number, rate)  # of so many switches that are on
    fails = [1.0 if k >= fatal else stats.norm.sf(limit - step * k) for k in range(number + 1)]
    name = f"switches {number} of {rate:g}, fatal {fatal}"
    return Case(name, 1, severity, 0.0, float(shares @ fails), np.full(number, rate))


def switched_cases():
    """Cases with switches.

    One fatal switch beside 8.5e-5 and rarer; two; eight; two that only fail together; many.
    """
    return [
        switched(1, 2e-4, 3.76, fatal=1),
        switched(1, 5e-5, 3.76, fatal=1),
        switched(2, 0.01, 4.0, 0.5),
        switched(8, 2e-3, 4.0, 0.5, fatal=2),
        switched(2, 0.01, 8.0, fatal=2),
        switched(7, 2e-3, 4.0, 0.5, fatal=3),
    ]


def _any_of(number, chance):
    """Chance that one at least of so many independent events happens."""
    return float(-np.expm1(number * np.log1p(-chance)))


def linear(dimension, beta):
    probability = stats.norm.sf(beta)
    return Case(
        f"linear {dimension}",
        dimension,
        lambda u: u.sum(axis=1) / np.sqrt(dimension),
        beta,
        probability,
    )


def paraboloid(dimension, beta, curvature=0.15):
    """Severity of u1 plus ``curvature`` times the other coordinates' squares.

    The limit state bends towards the origin, or away from it if ``curvature`` is negative.
    """
    law = stats.chi2(dimension - 1)
    value, _ = integrate.quad(
        lambda s: law.pdf(s) * stats.norm.sf(beta - curvature * s),
        0.0,
        law.isf(1e-16),
        limit=500,
        epsabs=1e-14,
    )
    severity = lambda u: u[:, 0] + curvature * (u[:, 1:] ** 2).sum(axis=1)  # noqa: E731
    return Case(f"quadratic {dimension}", dimension, severity, beta, value)


def ball(dimension, probability):
    """Outside of a ball."""
    threshold = stats.chi2.isf(probability, dimension)
    return Case(
        f"ball {dimension}", dimension, lambda u: (u**2).sum(axis=1), threshold, probability
    )


def four_branch(threshold):
    """Series system of four branches (Schueremans and Van Gemert).

    Two bent branches cross x, two straight ones cross y.
    """

    def severity(u):
        x, y = (
            (u[:, 0] + u[:, 1]) / np.sqrt(2.0),
            (u[:, 0] - u[:, 1]) / np.sqrt(2.0),
        )  # standard normal, too
        return np.maximum(np.abs(x) - 0.2 * y**2, np.sqrt(2.0) * np.abs(y) - 7.0 / np.sqrt(2.0))

    end = threshold / np.sqrt(2.0) + 3.5
    between, _ = integrate.quad(
        lambda y: stats.norm.pdf(y) * stats.norm.sf(threshold + 0.2 * y**2), -end, end, epsabs=1e-14
    )
    return Case(
        "four-branch 2", 2, severity, threshold, float(2.0 * (between + stats.norm.sf(end)))
    )


def onion(dimension, threshold, ripple=0.3, width=0.7):
    """Severity that rises with the radius in waves.

    The failures are shells with gaps between.
    """
    of_radius = lambda r: r + ripple * np.sin(2.0 * np.pi * r / width)  # noqa: E731
    radii = np.linspace(0.0, 40.0, 2_000_001)
    inside = of_radius(0.5 * (radii[1:] + radii[:-1])) > threshold
    probability = -np.diff(stats.chi(dimension).sf(radii))[inside].sum()
    severity = lambda u: of_radius(np.sqrt((u**2).sum(axis=1)))  # noqa: E731
    return Case(f"onion {dimension}", dimension, severity, threshold, float(probability))


def series(dimension, parts, beta):
    """One of ``parts`` independent components fails."""
    probability = _any_of(parts, stats.norm.sf(beta))
    return Case(
        f"series {dimension}", dimension, lambda u: u[:, :parts].max(axis=1), beta, probability
    )


def parallel(dimension, parts, beta):
    """All of ``parts`` independent components fail, each the mean of equally many coordinates."""
    share = dimension // parts

    def severity(u):
        return (
            u[:, : parts * share].reshape(len(u), parts, share).sum(axis=2) / np.sqrt(share)
        ).min(axis=1)

    return Case(
        f"parallel {dimension}", dimension, severity, beta, float(stats.norm.sf(beta) ** parts)
    )


def masked(dimension):
    """Severity of two branches.

    One fails at 4.5 sigma and rises early; the other is steep and fails at 4.0 sigma.
    """
    severity = lambda u: np.maximum(u[:, 0] - 4.5, 6.0 * (u[:, 1] - 4.0))  # noqa: E731
    probability = -np.expm1(np.log1p(-stats.norm.sf(4.5)) + np.log1p(-stats.norm.sf(4.0)))
    return Case(f"masked {dimension}", dimension, severity, 0.0, float(probability))


def corner(dimension):
    """Severity of two failure modes, one without warning.

    Three coordinates above 1.6 together fail abruptly; a gradual branch has 1.3e-5.
    """
    severity = lambda u: np.where((u[:, 1:4] > 1.6).all(axis=1), 1.0, u[:, 0] - 4.2)  # noqa: E731
    steep, gradual = stats.norm.sf(1.6) ** 3, stats.norm.sf(4.2)
    return Case(
        f"corner {dimension}", dimension, severity, 0.0, float(steep + gradual - steep * gradual)
    )


def random_crash(seed):
    """Severity with noise, beside a gradual branch of 1.3e-5.

    One flight in 50 beyond 3 sigma of u1 fails by its own noise.
    """
    noise = np.random.default_rng(seed)

    def severity(u):
        crashed = (u[:, 0] > 3.0) & (noise.random(len(u)) < 0.02)
        return np.where(crashed, 1.0, u[:, 1] - 4.2)

    gradual, crash = stats.norm.sf(4.2), 0.02 * stats.norm.sf(3.0)
    probability = gradual + crash - gradual * crash
    return Case("random crash", 2, severity, 0.0, float(probability))


def held_out_cases():
    """Cases on which nothing of the method was chosen: other shapes, other dimensions."""
    # A corner of the box of uniform factors fails (Irwin-Hall).
    uniform = lambda u: stats.norm.cdf(u).sum(axis=1)  # noqa: E731
    corners = [(n, p, n - (p * math.factorial(n)) ** (1.0 / n)) for n, p in ((3, 1e-4), (6, 1e-5))]
    # |u1 u2|: four places far apart; the other coordinates do nothing.
    product, _ = integrate.quad(lambda z: special.k0(z) / np.pi, 8.0, 68.0, epsabs=1e-16)
    two_balls = lambda u: np.minimum((u[:, :4] ** 2).sum(axis=1), (u[:, 4:] ** 2).sum(axis=1))  # noqa: E731
    return [
        *(Case(f"uniform sum {n}", n, uniform, limit, p) for n, p, limit in corners),
        Case(
            "exponential sum 8",
            8,
            lambda u: -stats.norm.logsf(u).sum(axis=1),
            stats.gamma(8).isf(1e-6),
            1e-6,
        ),
        Case("product 7", 7, lambda u: np.abs(u[:, 0] * u[:, 1]), 8.0, float(2.0 * product)),
        Case("two balls 8", 8, two_balls, stats.chi2.isf(np.sqrt(1e-5), 4), 1e-5),
        Case(
            "two-sided 20",
            20,
            lambda u: np.abs(u).max(axis=1),
            4.0,
            _any_of(20, 2.0 * stats.norm.sf(4.0)),
        ),
    ]


def all_cases():
    """The cases of the coverage study: from 1e-2 to 1e-7, dimension 2 to 100."""
    return [
        linear(2, 4.2649),  # 1e-5
        linear(10, 2.3263),  # 1e-2
        linear(50, 5.1993),  # 1e-7
        paraboloid(2, 4.5),
        paraboloid(10, 6.5),
        paraboloid(40, 0.3626, -0.15),  # 1e-5
        paraboloid(100, -6.1505, -0.15),  # 1e-5
        ball(12, 1e-5),
        ball(50, 1e-4),
        four_branch(3.0),
        four_branch(4.0),
        onion(2, 4.9),
        onion(10, 6.6),
        series(6, 6, 4.0),
        series(50, 50, 5.0),
        parallel(4, 2, 2.7),
        parallel(24, 3, 2.0),
    ]
