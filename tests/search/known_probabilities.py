"""Failure probabilities that are known: severities of standard normal points with a formula or an integral."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import integrate, optimize, stats


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
    """Curved towards the origin: u1 plus ``curvature`` times the other coordinates' squares."""

    def severity(u: np.ndarray) -> np.ndarray:
        return u[:, 0] + curvature * (u[:, 1:] ** 2).sum(axis=1)

    law = stats.chi2(dimension - 1)
    value, _ = integrate.quad(
        lambda s: law.pdf(s) * stats.norm.sf(beta - curvature * s), 0.0, law.isf(1e-16), limit=500, epsabs=1e-14
    )
    return Case(f"quadratic {dimension}", dimension, severity, beta, value)


def ball(dimension: int, probability: float) -> Case:
    """Outside of a ball."""
    return Case(
        f"ball {dimension}",
        dimension,
        lambda u: (u**2).sum(axis=1),
        stats.chi2.isf(probability, dimension),
        probability,
    )


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
    return Case(
        f"series {dimension}",
        dimension,
        lambda u: u[:, :parts].max(axis=1),
        beta,
        float(-np.expm1(parts * np.log1p(-stats.norm.sf(beta)))),
    )


def parallel(dimension: int, parts: int, beta: float) -> Case:
    """All of ``parts`` independent components fail, each the mean of equally many coordinates."""
    share = dimension // parts

    def severity(u: np.ndarray) -> np.ndarray:
        return (u[:, : parts * share].reshape(len(u), parts, share).sum(axis=2) / np.sqrt(share)).min(axis=1)

    return Case(f"parallel {dimension}", dimension, severity, beta, float(stats.norm.sf(beta) ** parts))


def all_cases() -> list[Case]:
    """The cases of the coverage study: from 1e-2 to 1e-7, dimension 2 to 50."""
    return [
        linear(2, 4.2649),  # 1e-5
        linear(10, 2.3263),  # 1e-2
        linear(50, 5.1993),  # 1e-7
        paraboloid(2, 4.5),
        paraboloid(10, 6.5),
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
