"""The design model against vector mechanics on a flat, still Earth, where the V / r terms are nothing."""

import numpy as np
import pytest
from numpy.typing import NDArray

from abhv_mc.control.design.design_model import attitude_rates

Floats = NDArray[np.float64]


def turn(axis: int, angle: float) -> Floats:
    """Components of a vector after the frame has turned by ``angle`` about an axis."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [k for k in range(3) if k != axis]
    sign = -1.0 if axis == 1 else 1.0
    m = np.eye(3)
    m[i, i] = m[j, j] = c
    m[i, j], m[j, i] = sign * s, -sign * s
    return m


def wind_from_ned(chi: float, gamma: float, bank: float) -> Floats:
    return turn(0, bank) @ turn(1, gamma) @ turn(2, chi)


def body_from_wind(alpha: float, beta: float) -> Floats:
    return turn(1, alpha) @ turn(2, -beta)


def angles_of(v: Floats, body_from_ned: Floats) -> Floats:
    """alpha, beta, bank of a velocity (NED) and an attitude."""
    u = body_from_ned @ v
    alpha, beta = np.arctan2(u[2], u[0]), np.arcsin(u[1] / np.linalg.norm(u))
    down = body_from_wind(alpha, beta).T @ body_from_ned @ np.array([0.0, 0.0, 1.0])
    return np.array([alpha, beta, np.arctan2(down[1], down[2])])


@pytest.mark.parametrize("seed", range(20))
def test_aero_angle_rates_are_those_of_vectors(seed: int) -> None:
    generator = np.random.default_rng(seed)
    alpha, beta, bank = generator.uniform([-0.1, -0.2, -1.3], [0.3, 0.2, 1.3])
    gamma, chi = generator.uniform([-0.6, -3.0], [0.6, 3.0])
    rates = generator.uniform(-0.5, 0.5, 3)
    force = generator.uniform(-3e4, 3e4, 3)
    mass, speed, gravity = 1372.0, 1400.0, 9.8
    attitude = body_from_wind(alpha, beta) @ wind_from_ned(chi, gamma, bank)
    v = speed * wind_from_ned(chi, gamma, bank).T @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(angles_of(v, attitude), [alpha, beta, bank], atol=1e-14)

    acceleration = attitude.T @ force / mass + [0.0, 0.0, gravity]
    p, q, r = rates
    spin = np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]])
    h = 1e-5
    ends = [angles_of(v + s * acceleration, attitude - s * spin @ attitude) for s in (-h, h)]
    expected = (ends[1] - ends[0]) / (2.0 * h)
    found = attitude_rates(force, mass, speed, gravity, gamma, (alpha, beta, bank), rates)
    np.testing.assert_allclose(found, expected, atol=1e-8)
