"""Margins against closed forms, python-control and slycot."""

import control
import numpy as np
import pytest
from vehicle.stability.systems import decibels, linear_at_trim, stability_at_trim

from abhv_mc_vehicle.kernel.stability.structured import (
    peak_of_structured_singular_values,
    structured_singular_values,
)
from abhv_mc_vehicle.stability.linearize import open_loop
from abhv_mc_vehicle.stability.margins import (
    close,
    disk_gain_and_phase,
    find_margins,
    loop_gains,
    make_loops,
)

PERIOD = 0.01


def _margins(systems, response):
    omega = np.tile(np.geomspace(1e-4, np.pi / PERIOD, 200), (systems, 1))
    return find_margins(response, omega, PERIOD)


def test_three_lags_have_the_margins_of_the_textbook():
    # k / (s + 1)^3: phase -180 deg at sqrt 3 rad/s, where the size is k / 8; |L| = 1 at
    # sqrt(k^(2/3) - 1).
    gains = np.array([4.0, 2.0])
    margins = _margins(2, lambda i, w: (gains[i] / (1j * w + 1.0) ** 3)[:, None, None])
    np.testing.assert_allclose(margins.gain_high[:, 0], 8.0 / gains, rtol=1e-10)
    np.testing.assert_allclose(margins.gain_high_frequency[:, 0], np.sqrt(3.0), rtol=1e-10)
    assert (margins.gain_low[:, 0] == 0.0).all() and np.isnan(margins.gain_low_frequency).all()
    crossover = np.sqrt(gains ** (2.0 / 3.0) - 1.0)
    phase = np.pi - 3.0 * np.arctan(crossover)
    np.testing.assert_allclose(margins.crossover[:, 0], crossover, rtol=1e-10)
    np.testing.assert_allclose(margins.phase[:, 0], phase, rtol=1e-10)
    np.testing.assert_allclose(margins.delay[:, 0], phase / crossover, rtol=1e-10)
    # The disk margin of a single loop, 1 / max |S - 1/2|, is that of all loops.
    np.testing.assert_allclose(margins.disk[:, 0], margins.all_disk, rtol=1e-6)


def test_a_conditionally_stable_loop_has_a_margin_on_each_side():
    # k (s + 1)^2 / s^3 is stable for k > 1/2.
    margins = _margins(1, lambda i, w: (2.0 * (1j * w + 1.0) ** 2 / (1j * w) ** 3)[:, None, None])
    np.testing.assert_allclose(margins.gain_low[0, 0], 0.25, rtol=1e-10)
    assert margins.gain_high[0, 0] == np.inf


def test_a_lead_has_its_phase_margin_above_minus_one():
    # k s^2 / (s + 1)^3: |L| = 1 at 1/2 rad/s, where the phase is 180 deg - 3 atan(1/2).
    k = 1.25**1.5 / 0.25
    margins = _margins(1, lambda _, w: (-k * w**2 / (1j * w + 1.0) ** 3)[:, None, None])
    np.testing.assert_allclose(margins.phase[0, 0], 3.0 * np.arctan(0.5), rtol=1e-10)


def test_a_loop_that_is_always_below_one_has_no_phase_or_delay_margin():
    margins = _margins(1, lambda i, w: (-0.5 / (1j * w + 1.0))[:, None, None])
    assert (
        margins.phase[0, 0] == np.inf
        and margins.delay[0, 0] == np.inf
        and np.isnan(margins.crossover[0, 0])
    )
    np.testing.assert_allclose(margins.gain_high[0, 0], 2.0, rtol=1e-12)  # at zero frequency
    np.testing.assert_allclose(
        margins.sensitivity[0, 0], 2.0, rtol=1e-6
    )  # there too, which the grid comes close to


def test_a_delay_common_to_two_loops_counts_in_both():
    # Two integrators that feed each other: eigenvalues (a +- b) / s of L, the fast one is the first
    # to go.
    a, b = 3.0, 1.0
    margins = _margins(1, lambda i, w: np.array([[a, b], [b, a]]) / (1j * w[:, None, None]))
    np.testing.assert_allclose(margins.all_delay, 0.5 * np.pi / (a + b), rtol=1e-9)


def test_responses_are_those_of_dense_linear_algebra():
    linear = linear_at_trim("tlc", 0.03)
    omega = np.array([0.01, 0.5, 7.0, 90.0, 314.0])
    gains = loop_gains(make_loops(linear), np.zeros(5, np.int64), omega)
    A, B, C = open_loop(linear, 0)
    assert A.shape == (66, 66)  # plant and actuators, the law, three old measurements
    for w, L in zip(omega, gains, strict=True):
        z = np.exp(1j * w * linear.period)
        expected = C @ np.linalg.solve(z * np.eye(len(A)) - A, B)
        # At 0.01 rad/s the condition number of the matrix is 6e11.
        np.testing.assert_allclose(L, expected, rtol=1e-8, atol=3e-9 * np.abs(expected).max())


@pytest.mark.parametrize("controller", ["tlc", "lqr_retuned_ghame_x"])
def test_single_loops_agree_with_python_control(controller):
    linear, margins = linear_at_trim(controller), stability_at_trim(controller).margins
    for i in range(4):
        # python-control interpolates between frequencies: they stand dense about where its answers
        # are.
        points = [
            margins.gain_low_frequency[0, i],
            margins.gain_high_frequency[0, i],
            margins.crossover[0, i],
        ]
        near = [
            p * np.linspace(1.0 - 1e-5, 1.0 + 1e-5, 31)
            for p in points
            if np.isfinite(p) and p > 0.0
        ]
        omega = np.unique(
            np.concatenate([np.geomspace(0.01, 0.999 * np.pi / linear.period, 2000), *near])
        )
        _, closed = close(loop_gains(make_loops(linear), np.zeros(omega.size, np.int64), omega))
        data = control.FrequencyResponseData(closed.L[:, i], omega, smooth=True)
        gains, phases, _, _, crossings, _ = control.stability_margins(data, returnall=True)
        expected = [margins.gain_high[0, i]]
        if margins.gain_low_frequency[0, i] > 0.01:
            expected.append(margins.gain_low[0, i])
        for gain in expected:
            np.testing.assert_allclose(
                gains[np.abs(np.log(gains / gain)).argmin()], gain, rtol=1e-6
            )
        np.testing.assert_allclose(np.deg2rad(np.abs(phases).min()), margins.phase[0, i], rtol=1e-6)
        worst = crossings[np.abs(phases).argmin()]
        np.testing.assert_allclose(worst, margins.crossover[0, i], rtol=1e-6)


@pytest.mark.parametrize("controller", ["tlc", "lqr_retuned_ghame_x"])
def test_all_inputs_agree_with_disk_margins_of_python_control(controller):
    linear, margins = linear_at_trim(controller), stability_at_trim(controller).margins
    peak = margins.all_disk_frequency[0]
    omega = np.sort(np.append(np.geomspace(0.9 * peak, 1.1 * peak, 20), peak))
    A, B, C = open_loop(linear, 0)
    loop = control.ss(A, B, C, np.zeros((4, 4)), linear.period)
    alpha, gain, phase = control.disk_margins(loop, omega, skew=0.0)
    np.testing.assert_allclose(margins.all_disk[0], alpha, rtol=1e-4)
    own_gain, own_phase = disk_gain_and_phase(margins.all_disk)
    np.testing.assert_allclose(decibels(own_gain)[0], gain, rtol=1e-3)
    np.testing.assert_allclose(np.rad2deg(own_phase)[0], phase, rtol=1e-3)


def test_structured_singular_values_are_as_tight_as_slycots():
    from slycot import ab13md

    rng = np.random.default_rng(5)
    M = rng.normal(size=(100, 4, 4)) + 1j * rng.normal(size=(100, 4, 4))
    M *= 10.0 ** rng.normal(size=(100, 4, 4))
    values = structured_singular_values(M)
    theirs = np.array([ab13md(matrix, np.ones(4, int), 2 * np.ones(4, int))[0] for matrix in M])
    assert (values < theirs * (1.0 + 1e-4)).all()
    radius = np.abs(np.linalg.eigvals(M)).max(axis=-1)
    assert (values > radius * (1.0 - 1e-12)).all()


def test_the_peak_over_frequency_is_the_largest_of_all():
    rng = np.random.default_rng(7)
    M = rng.normal(size=(5, 40, 4, 4)) + 1j * rng.normal(size=(5, 40, 4, 4))
    values = structured_singular_values(M.reshape(-1, 4, 4)).reshape(5, 40)
    value, index = peak_of_structured_singular_values(M)
    np.testing.assert_allclose(value, values.max(axis=1), rtol=1e-7)
    np.testing.assert_array_equal(index, values.argmax(axis=1))
