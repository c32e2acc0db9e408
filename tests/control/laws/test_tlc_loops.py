"""The loops are exact: with A and B of the design model by complex step, ``A - B K`` is the wanted matrix.

Zhu and Shen 2014, equations (10), (13)-(18), (20), (21).
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from abhv_mc.control.design.design_model import Surroundings, attitude_rates, body_rate_rates, wrench_at
from abhv_mc.control.design.design_tables import slope
from abhv_mc.control.laws.tlc_loops import (
    AttitudePoint,
    Inertia,
    Spectrum,
    attitude_gains,
    attitude_inverse,
    differentiator_next,
    differentiator_output,
    moment_inverse,
    rate_gains,
)
from abhv_mc.vehicle.model import Vehicle

Floats = NDArray[np.float64]
AROUND = Surroundings(20e3, 0.0889, 295.07, 9.75, 6.37e6, 0.5)
SPECTRUM = Spectrum(0.09, 2.04, 0.16, 1.9, 0.25, 1.7)  # all different, so that no two channels can be swapped


def wanted(spectrum: Spectrum) -> Floats:
    """A_c of (10) on (integral, state) of three channels."""
    A = np.zeros((6, 6))
    for i in range(3):
        A[2 * i, 2 * i + 1] = 1.0
        A[2 * i + 1, 2 * i : 2 * i + 2] = -spectrum[2 * i], -spectrum[2 * i + 1]
    return A


def closed(A: Floats, B: Floats, K: tuple[float, ...]) -> Floats:
    """``A - B K`` with the integrals of the three states in front of each."""
    augmented_A, augmented_B = np.zeros((6, 6)), np.zeros((6, 3))
    augmented_A[0::2, 1::2] = np.eye(3)
    augmented_A[1::2, 1::2] = A
    augmented_B[1::2] = B
    return augmented_A - augmented_B @ np.array(K).reshape(3, 6)


def random_nominals(count: int) -> list[tuple[float, ...]]:
    """(mach, alpha, bank, gamma, eta, elevator, alpha', bank') over the envelope."""
    low = np.array([4.3, -0.01, -1.2, -0.3, 0.1, -0.1, -0.1, -0.3])
    high = np.array([5.2, 0.20, 1.2, 0.3, 1.4, 0.1, 0.1, 0.3])
    return [tuple(x) for x in np.random.default_rng(7).uniform(low, high, (count, low.size)).tolist()]


@pytest.mark.parametrize("nominal", random_nominals(40))
def test_attitude_loop_is_exact(vehicle: Vehicle, nominal: tuple[float, ...]) -> None:
    mach, alpha, bank, gamma, eta, elevator, alpha_dot, bank_dot = nominal
    speed, mass = mach * AROUND.sound_speed, 1300.0

    def rates_of(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Rates of (alpha, beta, bank) for these and (p, q, r); forces of the full tables, rates not felt by them."""
        still = (0.0, 0.0, 0.0)
        wrench = wrench_at(vehicle, AROUND, mass, speed, x[0], x[1], still, (0.0, 0.0, elevator), eta)
        return attitude_rates(wrench.force, mass, speed, AROUND.gravity, gamma, x[:3], x[3:])

    # What the law reads from its tables: forces and their slopes at the nominal.
    def forces_of(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        still = (0.0, 0.0, 0.0)
        full = wrench_at(vehicle, AROUND, mass, speed, x[0], x[1], still, (0.0, 0.0, elevator), eta).force
        idle = wrench_at(vehicle, AROUND, mass, speed, x[0], x[1], still, (0.0, 0.0, elevator), 0.0).force
        normal = full[0] * np.sin(x[0]) - full[2] * np.cos(x[0])
        drag = -(idle[0] * np.cos(x[0]) + idle[2] * np.sin(x[0]))
        axial = (full - idle)[0] * np.cos(x[0]) + (full - idle)[2] * np.sin(x[0])
        side = idle[1] * np.cos(x[1]) + drag * np.sin(x[1])  # wind axes
        return np.stack([normal, side, axial])

    at = np.array([alpha, 0.0])
    normal, side, axial = np.real(forces_of(at[:, None] + 0j))[:, 0]
    slopes = slope(forces_of, at)
    point = AttitudePoint(
        mass * speed,
        AROUND.gravity / speed,
        np.sin(alpha),
        np.cos(alpha),
        np.sin(bank),
        np.cos(bank),
        np.cos(gamma),
        np.tan(gamma),
        normal,
        slopes[0, 0],
        axial,
        side,
        slopes[1, 1],
    )
    p, q, r = attitude_inverse(point, alpha_dot, 0.0, bank_dot)
    x = np.array([alpha, 0.0, bank, p, q, r])
    inverted = np.real(rates_of(x[:, None] + 0j))[:, 0]
    np.testing.assert_allclose(inverted, [alpha_dot, 0.0, bank_dot], atol=1e-14)

    J = slope(rates_of, x)
    found = closed(J[:, :3], J[:, 3:], attitude_gains(point, p, r, SPECTRUM))
    np.testing.assert_allclose(found, wanted(SPECTRUM), atol=1e-9 * np.abs(J).max())


inertias = st.tuples(
    st.floats(50.0, 2e6), st.floats(500.0, 3e7), st.floats(500.0, 3e7), st.floats(-0.9, 0.9), st.floats(0.1, 10.0)
)
rates = st.tuples(*[st.floats(-2.0, 2.0)] * 3)


@settings(max_examples=100, deadline=None)
@given(inertias, rates, rates)
def test_rate_loop_is_exact(
    size: tuple[float, ...], rate: tuple[float, float, float], rate_dot: tuple[float, float, float]
) -> None:
    xx, yy, zz, coupling, _ = size
    inertia = Inertia(xx, yy, zz, coupling * np.sqrt(xx * zz))
    matrix = np.array([[xx, 0.0, inertia.e13], [0.0, yy, 0.0], [inertia.e13, 0.0, zz]])
    moment = moment_inverse(inertia, *rate, *rate_dot)

    def rates_of(x: NDArray[np.complex128]) -> NDArray[np.complex128]:
        shape = (3, 3, x.shape[1])
        return body_rate_rates(np.broadcast_to(matrix[..., None], shape), x[3:], x[:3])

    x = np.array([*rate, *moment])
    scale = np.linalg.cond(matrix) * (1.0 + np.abs(rate_dot).max() + np.abs(rate).max() ** 2)
    np.testing.assert_allclose(np.real(rates_of(x[:, None] + 0j))[:, 0], rate_dot, atol=1e-14 * scale)
    J = slope(rates_of, x)
    found = closed(J[:, :3], J[:, 3:], rate_gains(inertia, *rate, SPECTRUM))
    np.testing.assert_allclose(found, wanted(SPECTRUM), atol=1e-9 * max(1.0, np.abs(J[:, :3]).max()))


@pytest.mark.parametrize("bandwidth", [0.3, 1.5])
def test_differentiator_has_the_frequency_response_of_21(bandwidth: float) -> None:
    """``wd s / (s + wd)`` of a sampled sine, up to a tenth of the sampling rate, sampled at 100 Hz and held."""
    tick = 0.01
    decay = float(np.exp(-bandwidth * tick))
    for omega in (0.03, 0.3, 3.0):
        times = np.arange(0.0, 200.0 + 4.0 * np.pi / omega, tick)
        state, outputs = 0.0, []
        for u in np.sin(omega * times):
            outputs.append(differentiator_output(bandwidth, state, u))
            state = differentiator_next(decay, state, u)
        late = times > 200.0
        basis = np.stack([np.sin(omega * times[late]), np.cos(omega * times[late])], axis=1)
        a, b = np.linalg.lstsq(basis, np.array(outputs)[late], rcond=None)[0]
        expected = bandwidth * 1j * omega / (1j * omega + bandwidth)
        # Holding delays the state by half a tick: a phase error of at most omega tick / 2 of the filtered part.
        assert abs(complex(a, b) - expected) < 0.6 * omega * tick * bandwidth
