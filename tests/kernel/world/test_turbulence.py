"""Dryden turbulence against its spectrum (MIL-F-8785C, 3.7.1.2), and the 1-cosine gust."""

import numpy as np
import pytest
from scipy import signal

from abhv_mc.kernel.jit import kernel
from abhv_mc.kernel.world.turbulence import (
    dryden_first,
    dryden_second,
    dryden_second_output,
    one_minus_cosine,
)

V, L, DT = 1400.0, 533.4, 0.01
A = V / L


@kernel
def _simulate(noise, a, dt):
    n = noise.shape[0]
    out = np.empty((n, 2))
    u, x1, x2 = 0.0, 0.0, 0.0
    for i in range(n):
        u = dryden_first(u, a, dt, noise[i, 0]) if i > 0 else noise[0, 0]
        x1, x2 = dryden_second(x1, x2, a, dt, noise[i, 1], noise[i, 2], i == 0)
        out[i, 0], out[i, 1] = u, dryden_second_output(x1, x2, a)
    return out


@pytest.fixture(scope="module")
def gusts() -> np.ndarray:
    noise = np.random.default_rng(8785).standard_normal((400_000, 3))
    return _simulate(noise, A, DT)


def test_unit_variance_from_the_start(gusts: np.ndarray) -> None:
    assert gusts.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.03)
    rng = np.random.default_rng(3)
    draws = rng.standard_normal((20_000, 2)).tolist()
    starts = [dryden_second_output(*dryden_second(0.0, 0.0, A, DT, *noise, True), A) for noise in draws]
    assert np.std(starts) == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize("component", [0, 1])
def test_spectrum(gusts: np.ndarray, component: int) -> None:
    """One-sided spectra over frequency, well below the sampling rate; averaged in bands, within 10 %."""
    frequency, power = signal.welch(gusts[:, component], fs=1.0 / DT, nperseg=8192)
    x = 2.0 * np.pi * frequency / A
    longitudinal = 4.0 / A / (1.0 + x**2)
    lateral = 2.0 / A * (1.0 + 3.0 * x**2) / (1.0 + x**2) ** 2
    expected = longitudinal if component == 0 else lateral
    for low, high in [(0.05, 0.2), (0.2, 0.5), (0.5, 1.0), (1.0, 2.0), (2.0, 5.0)]:
        band = (frequency > low) & (frequency < high)
        assert power[band].mean() == pytest.approx(expected[band].mean(), rel=0.1)


def test_the_step_does_not_matter() -> None:
    """Exact discretisation: two half steps have the covariance of a whole one."""
    rng = np.random.default_rng(5)
    noise = rng.standard_normal((60_000, 3))
    for dt in (0.001, 0.1, 0.5):
        out = _simulate(noise, A, dt)
        assert out.std(axis=0) == pytest.approx([1.0, 1.0], rel=0.12)


def test_one_minus_cosine() -> None:
    assert [one_minus_cosine(x, 1000.0) for x in (-50.0, 0.0, 500.0, 1000.0, 5000.0)] == pytest.approx(
        [0.0, 0.0, 0.5, 1.0, 1.0], abs=1e-12
    )
    assert one_minus_cosine(250.0, 1000.0) == pytest.approx(0.5 * (1.0 - np.cos(np.pi / 4.0)), abs=1e-14)
