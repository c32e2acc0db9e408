"""Failure probabilities that are known: severities of standard normal points with a formula or an integral."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import integrate, optimize, special, stats


@dataclass(frozen=True)
class SwitchedCase:
    """A severity of points and switches [switch] that come with ``rates``, and P(severity > 0)."""

    name: str
    rates: np.ndarray
    severity: Callable[[np.ndarray, np.ndarray], np.ndarray]
    probability: float


def switched(number: int, rate: float, limit: float, step: float = 0.0, fatal: int = 99) -> SwitchedCase:
    """u1 above a limit that each switch lowers by ``step``; ``fatal`` switches together always fail."""

    def severity(u: np.ndarray, on: np.ndarray) -> np.ndarray:
        count = on.sum(axis=1)
        return np.where(count >= fatal, 1.0, u[:, 0] - limit + step * count)

    shares = stats.binom.pmf(np.arange(number + 1), number, rate)  # of so many switches that are on
    fails = [1.0 if k >= fatal else stats.norm.sf(limit - step * k) for k in range(number + 1)]
    name = f"switches {number} of {rate:g}, fatal {fatal}"
    return SwitchedCase(name, np.full(number, rate), severity, float(shares @ fails))


def switched_cases() -> list[SwitchedCase]:
    """One that is fatal beside 8.5e-5, rare and rarer; two; eight; two that only fail together; a stratum of many."""
    return [
        switched(1, 2e-4, 3.76, fatal=1),
        switched(1, 5e-5, 3.76, fatal=1),
        switched(2, 0.01, 4.0, 0.5),
        switched(8, 2e-3, 4.0, 0.5, fatal=2),
        switched(2, 0.01, 8.0, fatal=2),
        switched(7, 2e-3, 4.0, 0.5, fatal=3),
    ]


@dataclass(frozen=True)
class Case:
    """A severity, its dimension, and P(severity > threshold)."""

    name: str
    dimension: int
    severity: Callable[[np.ndarray], np.ndarray]
    threshold: float
    probability: float


def linear(dimension: int, beta: float) -> Case:
    return Case(
        f"linear {dimension}", dimension, lambda u: u.sum(axis=1) / np.sqrt(dimension), beta, stats.norm.sf(beta)
    )


def paraboloid(dimension: int, beta: float, curvature: float = 0.15) -> Case:
    """u1 plus ``curvature`` times the other coordinates' squares: towards the origin, below zero away from it."""

    def severity(u: np.ndarray) -> np.ndarray:
        return u[:, 0] + curvature * (u[:, 1:] ** 2).sum(axis=1)

    law = stats.chi2(dimension - 1)
    value, _ = integrate.quad(
        lambda s: law.pdf(s) * stats.norm.sf(beta - curvature * s), 0.0, law.isf(1e-16), limit=500, epsabs=1e-14
    )
    return Case(f"quadratic {dimension}", dimension, severity, beta, value)


def ball(dimension: int, probability: float) -> Case:
    """Outside of a ball."""
    threshold = stats.chi2.isf(probability, dimension)
    return Case(f"ball {dimension}", dimension, lambda u: (u**2).sum(axis=1), threshold, probability)


def _branches(u: np.ndarray) -> np.ndarray:
    a, b = u[..., 0], u[..., 1]
    bowl = 0.1 * (a - b) ** 2
    apart = np.abs(a - b) - 7.0 / np.sqrt(2.0)
    return np.maximum(-(bowl - np.abs(a + b) / np.sqrt(2.0)), apart)


def four_branch(threshold: float) -> Case:
    """Schueremans & Van Gemert's series system of four branches, in its two dimensions."""

    def inner(angle: float) -> float:
        """P(fail) along a ray, from the radii at which it begins and ends to fail."""
        direction = np.array([np.cos(angle), np.sin(angle)])
        radii = np.linspace(0.0, 12.0, 2401)
        excess = _branches(radii[:, None] * direction) - threshold
        crossings = np.flatnonzero(np.diff(np.sign(excess)))
        total, sign = 0.0, 1.0
        for i in crossings:
            root = optimize.brentq(lambda r: _branches(r * direction) - threshold, radii[i], radii[i + 1])
            total += sign * np.exp(-0.5 * root**2)
            sign = -sign
        return total

    angles = np.linspace(0.0, 2.0 * np.pi, 2000, endpoint=False)
    return Case("four-branch 2", 2, _branches, threshold, float(np.mean([inner(angle) for angle in angles])))


def onion(dimension: int, threshold: float, ripple: float = 0.3, width: float = 0.7) -> Case:
    """Rings: the severity rises with the radius in waves, so that the failures are shells with gaps between."""

    def of_radius(r: np.ndarray) -> np.ndarray:
        return r + ripple * np.sin(2.0 * np.pi * r / width)

    law = stats.chi(dimension)
    radii = np.linspace(0.0, law.isf(1e-20) + 5.0, 20001)
    excess = of_radius(radii) - threshold
    roots = [
        optimize.brentq(lambda r: of_radius(r) - threshold, radii[i], radii[i + 1])
        for i in np.flatnonzero(np.diff(np.sign(excess)))
    ]
    probability = sum(sign * law.sf(root) for root, sign in zip(roots, np.resize([1.0, -1.0], len(roots)), strict=True))
    return Case(
        f"onion {dimension}", dimension, lambda u: of_radius(np.sqrt((u**2).sum(axis=1))), threshold, float(probability)
    )


def series(dimension: int, parts: int, beta: float) -> Case:
    """One of ``parts`` independent components fails."""
    probability = float(-np.expm1(parts * np.log1p(-stats.norm.sf(beta))))
    return Case(f"series {dimension}", dimension, lambda u: u[:, :parts].max(axis=1), beta, probability)


def parallel(dimension: int, parts: int, beta: float) -> Case:
    """All of ``parts`` independent components fail, each the mean of equally many coordinates."""
    share = dimension // parts

    def severity(u: np.ndarray) -> np.ndarray:
        return (u[:, : parts * share].reshape(len(u), parts, share).sum(axis=2) / np.sqrt(share)).min(axis=1)

    return Case(f"parallel {dimension}", dimension, severity, beta, float(stats.norm.sf(beta) ** parts))


def uniform_sum(dimension: int, probability: float) -> Case:
    """The sum of uniform laws, as a campaign disperses factors: a corner of the box fails (Irwin-Hall)."""
    short = (probability * math.factorial(dimension)) ** (1.0 / dimension)
    assert short <= 1.0
    name = f"uniform sum {dimension}"
    return Case(name, dimension, lambda u: stats.norm.cdf(u).sum(axis=1), dimension - short, probability)


def exponential_sum(dimension: int, probability: float) -> Case:
    """The sum of exponential laws."""
    name, threshold = f"exponential sum {dimension}", stats.gamma(dimension).isf(probability)
    return Case(name, dimension, lambda u: -stats.norm.logsf(u).sum(axis=1), threshold, probability)


def product(dimension: int, threshold: float) -> Case:
    """|u1 u2|: four places far apart; the other coordinates do nothing."""
    value, _ = integrate.quad(lambda z: special.k0(z) / np.pi, threshold, threshold + 60.0, epsabs=1e-16)
    return Case(f"product {dimension}", dimension, lambda u: np.abs(u[:, 0] * u[:, 1]), threshold, float(2.0 * value))


def two_balls(dimension: int, probability: float) -> Case:
    """Outside of a ball in one half of the coordinates and in the other, too."""
    half = dimension // 2

    def severity(u: np.ndarray) -> np.ndarray:
        return np.minimum((u[:, :half] ** 2).sum(axis=1), (u[:, half:] ** 2).sum(axis=1))

    return Case(f"two balls {dimension}", dimension, severity, stats.chi2.isf(np.sqrt(probability), half), probability)


def two_sided(dimension: int, beta: float) -> Case:
    """One of the coordinates is far from zero on either side."""
    probability = float(-np.expm1(dimension * np.log1p(-2.0 * stats.norm.sf(beta))))
    return Case(f"two-sided {dimension}", dimension, lambda u: np.abs(u).max(axis=1), beta, probability)


def masked(dimension: int) -> Case:
    """A branch that fails at 4.5 sigma, along which severity rises early, and a steep one that fails at 4.0."""

    def severity(u: np.ndarray) -> np.ndarray:
        return np.maximum(u[:, 0] - 4.5, 6.0 * (u[:, 1] - 4.0))

    probability = -np.expm1(np.log1p(-stats.norm.sf(4.5)) + np.log1p(-stats.norm.sf(4.0)))
    return Case(f"masked {dimension}", dimension, severity, 0.0, float(probability))


def corner(dimension: int) -> Case:
    """Three coordinates above 1.6 together, of which severity gives no warning, beside a gradual branch of 1.3e-5."""

    def severity(u: np.ndarray) -> np.ndarray:
        return np.where((u[:, 1:4] > 1.6).all(axis=1), 1.0, u[:, 0] - 4.2)

    steep, gradual = stats.norm.sf(1.6) ** 3, stats.norm.sf(4.2)
    return Case(f"corner {dimension}", dimension, severity, 0.0, float(steep + gradual - steep * gradual))


def held_out_cases() -> list[Case]:
    """Cases on which nothing of the method was chosen: other shapes, other dimensions."""
    return [
        uniform_sum(3, 1e-4),
        uniform_sum(6, 1e-5),
        exponential_sum(8, 1e-6),
        product(7, 8.0),
        two_balls(8, 1e-5),
        two_sided(20, 4.0),
    ]


def all_cases() -> list[Case]:
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
