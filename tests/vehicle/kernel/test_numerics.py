"""Quaternions and Brent's method against scipy, and MRG32k3a with its seeding."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from abhv_mc_vehicle.kernel.jit import kernel
from abhv_mc_vehicle.kernel.numerics import quaternion
from abhv_mc_vehicle.kernel.numerics.random_numbers import (
    M1,
    M2,
    next_uniform,
    normal_pair,
    seed_word,
)
from abhv_mc_vehicle.kernel.numerics.root_finding import (
    CONVERGED,
    NO_SIGN_CHANGE,
    NOT_A_NUMBER,
    OUT_OF_ITERATIONS,
    brent,
)

ANGLES = st.floats(-math.pi, math.pi)
PITCHES = st.floats(-math.pi / 2, math.pi / 2)
COMPONENTS = st.floats(-1e3, 1e3)


@given(ANGLES, PITCHES, ANGLES, COMPONENTS, COMPONENTS, COMPONENTS)
def test_rotations_agree_with_scipy(yaw, pitch, roll, x, y, z):
    q = quaternion.from_euler(yaw, pitch, roll)
    ned = quaternion.rotate_to_ned(*q, x, y, z)
    assert ned == pytest.approx(
        Rotation.from_euler("ZYX", [yaw, pitch, roll]).apply([x, y, z]), abs=1e-11
    )
    assert quaternion.rotate_to_body(*q, *ned) == pytest.approx((x, y, z), abs=1e-11)
    assert quaternion.rotate_meridional(*q, x, z) == quaternion.rotate_to_body(*q, x, 0.0, z)


@given(ANGLES, PITCHES, ANGLES, st.tuples(*[st.floats(-2.0, 2.0)] * 3))
def test_rate_is_the_derivative_of_turning_about_body_axes(yaw, pitch, roll, rate):
    q = np.array(quaternion.from_euler(yaw, pitch, roll))
    step = 1e-4
    attitude = Rotation.from_quat(q, scalar_first=True)
    ahead, behind = (
        (attitude * Rotation.from_rotvec(sign * step * np.array(rate))).as_quat(scalar_first=True)
        for sign in (1, -1)
    )
    ahead, behind = (value * np.sign(np.dot(value, q)) for value in (ahead, behind))
    derivative = quaternion.quaternion_rate(*q, *rate)
    assert derivative == pytest.approx((ahead - behind) / (2 * step), abs=1e-7)
    assert np.dot(derivative, q) == pytest.approx(0.0, abs=1e-15)


@numba.njit
def cubic(x, a, b):
    return (x - a) * ((x - b) * (x - b) + 0.1)


@numba.njit
def flat(x, a, b):
    return (x - a) ** 9 * (1.0 + b * b)


@numba.njit
def kinked(x, a, b):
    return (x - a) * (1.0 + abs(b)) if x > a else 0.01 * (x - a)


@pytest.mark.parametrize("function", [cubic, flat, kinked])
def test_same_root_as_scipy_in_as_many_iterations(function):
    generator = np.random.default_rng(11)
    for a, b, low, high in generator.uniform((-2, -2, -9, 3), (2, 2, -3, 9), (600, 4)).tolist():
        tolerance = 1e-10
        expected, result = brentq(
            function,
            low,
            high,
            args=(a, b),
            xtol=tolerance,
            rtol=1e-15,
            maxiter=500,
            full_output=True,
        )
        root, iterations, status = brent(function, (a, b), low, high, tolerance, 500)
        assert status == CONVERGED
        # at a nonuple root the last bits steer the path
        assert iterations <= result.iterations + (30 if function is flat else 2)
        assert root == pytest.approx(expected, abs=2 * tolerance)
        assert function(root - tolerance, a, b) * function(root + tolerance, a, b) <= 0.0


@numba.njit
def holed(x, a, b):
    return math.nan if abs(x) < 0.3 else x


@pytest.mark.parametrize(
    ("function", "low", "high", "expected"),
    [
        (cubic, 2.0, 5.0, (2.0, 0, NO_SIGN_CHANGE)),  # the end with the smaller residual
        (cubic, 5.0, 2.0, (2.0, 0, NO_SIGN_CHANGE)),
        (cubic, 1.0, 5.0, (1.0, 0, CONVERGED)),  # a root at an end
        (cubic, -5.0, 1.0, (1.0, 0, CONVERGED)),
        (holed, 0.1, 1.0, (1.0, 0, NO_SIGN_CHANGE)),  # not a number at an end
        (holed, -1.0, 0.1, (-1.0, 0, NO_SIGN_CHANGE)),
    ],
)
def test_an_end_that_needs_no_search(function, low, high, expected):
    assert brent(function, (1.0, 0.0), low, high, 1e-9, 100) == expected


def test_a_failed_search_returns_its_status():
    assert brent(flat, (0.123, 0.0), -5.0, 7.0, 1e-12, 6)[1:] == (6, OUT_OF_ITERATIONS)
    assert brent(holed, (0.0, 0.0), -1.0, 1.0, 1e-9, 100)[2] == NOT_A_NUMBER


@kernel
def _stream(state, n):
    out = np.empty(n)
    s0, s1, s2, s3, s4, s5 = state[0], state[1], state[2], state[3], state[4], state[5]
    for i in range(n):
        out[i], s0, s1, s2, s3, s4, s5 = next_uniform(s0, s1, s2, s3, s4, s5)
    return out


def _words(seed):
    return np.array([seed_word(seed, float(i), M1 if i < 3 else M2) for i in range(6)])


def test_the_published_sequence_and_the_recurrence_in_integers():
    """First numbers for the seed 12345 in all six words, from the documentation of RngStreams."""
    published = [
        0.12701112204657714,
        0.3185275653967945,
        0.3091860155832701,
        0.8258468629271136,
        0.2216299157820229,
    ]
    numbers = _stream(np.full(6, 12345.0), 2000)
    assert numbers[:5] == pytest.approx(published, abs=1e-15)
    s = [12345] * 6
    m1, m2 = int(M1), int(M2)
    for number in numbers:
        p1 = (1403580 * s[1] - 810728 * s[0]) % m1
        p2 = (527612 * s[5] - 1370589 * s[3]) % m2
        s = [s[1], s[2], p1, s[4], s[5], p2]
        assert number == (p1 - p2 if p1 > p2 else p1 - p2 + m1) * 2.328306549295728e-10


@pytest.mark.parametrize("seed", [0.0, 0.25, 0.5, 1.0 - 2**-53])
def test_a_seed_gives_uniform_numbers(seed):
    numbers = _stream(_words(seed), 20_000)[8:]
    assert numbers.min() > 0.0 and numbers.max() < 1.0
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(numbers[:-1], numbers[1:])[0, 1]) < 0.03


def test_seeds_do_not_share_streams():
    """States are valid, and first numbers are uniform and uncorrelated over neighbouring seeds."""
    seeds = np.random.default_rng(1).random(4000)
    states = np.array([_words(seed) for seed in seeds])
    assert (states >= 1.0).all() and (states[:, :3] < M1).all() and (states[:, 3:] < M2).all()
    assert (states == np.round(states)).all()
    first = np.array([_stream(state, 9)[8] for state in states])
    assert stats.kstest(first, "uniform").pvalue > 1e-3
    assert abs(np.corrcoef(first, seeds)[0, 1]) < 0.06
    close = np.array([_stream(_words(0.4 + k * 1e-12), 9)[8] for k in range(500)])
    assert np.unique(close).size == close.size
    assert stats.kstest(close, "uniform").pvalue > 1e-3


def test_normal_pair():
    pairs = np.array([normal_pair(a, b) for a, b in _stream(_words(0.3), 16_000).reshape(-1, 2)])
    assert stats.kstest(pairs[:, 0], "norm").pvalue > 1e-3
    assert stats.kstest(pairs[:, 1], "norm").pvalue > 1e-3
    assert abs(np.corrcoef(pairs.T)[0, 1]) < 0.05
