"""Brent's method against scipy's, on hard functions, and from a cached kernel."""

import math

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from abhv_mc.kernel.numerics.root_finding import CONVERGED, NO_SIGN_CHANGE, NOT_A_NUMBER, OUT_OF_ITERATIONS, brent


@numba.njit
def cubic(x: float, a: float, b: float) -> float:
    return (x - a) * ((x - b) * (x - b) + 0.1)


@numba.njit
def steep(x: float, a: float, b: float) -> float:
    return math.atan(b * b * 100.0 * (x - a))


@numba.njit
def flat(x: float, a: float, b: float) -> float:
    return (x - a) ** 9 * (1.0 + b * b)


@numba.njit
def kinked(x: float, a: float, b: float) -> float:
    return (x - a) * (1.0 + abs(b)) if x > a else 0.01 * (x - a)


@numba.njit
def wave(x: float, a: float, b: float) -> float:
    return math.sin(3.0 * x + b) + 0.3 * (x - a)


@pytest.mark.parametrize("function", [cubic, steep, flat, kinked, wave])
def test_same_root_as_scipy_in_as_many_iterations(function: numba.core.dispatcher.Dispatcher) -> None:
    generator = np.random.default_rng(11)
    compared = 0
    for a, b, low, high in generator.uniform((-2, -2, -9, 3), (2, 2, -3, 9), (600, 4)).tolist():
        if function(low, a, b) * function(high, a, b) >= 0.0:
            continue
        tolerance = 1e-10
        expected, result = brentq(
            function, low, high, args=(a, b), xtol=tolerance, rtol=1e-15, maxiter=500, full_output=True
        )
        root, iterations, status = brent(function, (a, b), low, high, tolerance, 500)
        assert status == CONVERGED
        # at a nonuple root the last bits steer the path
        assert iterations <= result.iterations + (30 if function is flat else 2)
        if function is not wave:  # which has several roots
            assert root == pytest.approx(expected, abs=2 * tolerance)
        assert function(root - tolerance, a, b) * function(root + tolerance, a, b) <= 0.0
        compared += 1
    assert compared > 500


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6), st.floats(1e-6, 1e6), st.floats(-3, 3))
def test_root_stays_bracketed_and_within_tolerance(root: float, left: float, right: float, b: float) -> None:
    found, _, status = brent(kinked, (root, b), root - left, root + right, 1e-9, 200)
    assert status == CONVERGED
    assert root - left <= found <= root + right
    assert found == pytest.approx(root, abs=1e-9 + 1e-15 * abs(root))


@numba.njit
def holed(x: float, a: float, b: float) -> float:
    return math.nan if abs(x) < 0.3 else x


@pytest.mark.parametrize(
    ("function", "low", "high", "found"),
    [
        (cubic, 2.0, 5.0, (2.0, 0, NO_SIGN_CHANGE)),  # the end with the smaller residual
        (cubic, 5.0, 2.0, (2.0, 0, NO_SIGN_CHANGE)),
        (cubic, 1.0, 5.0, (1.0, 0, CONVERGED)),  # a root at an end
        (cubic, -5.0, 1.0, (1.0, 0, CONVERGED)),
        (holed, 0.1, 1.0, (1.0, 0, NO_SIGN_CHANGE)),  # not a number at an end
        (holed, -1.0, 0.1, (-1.0, 0, NO_SIGN_CHANGE)),
    ],
)
def test_an_end_that_needs_no_search(function: numba.core.dispatcher.Dispatcher, low, high, found) -> None:
    assert brent(function, (1.0, 0.0), low, high, 1e-9, 100) == found


def test_a_search_that_fails_says_why() -> None:
    assert brent(flat, (0.123, 0.0), -5.0, 7.0, 1e-12, 6)[1:] == (6, OUT_OF_ITERATIONS)
    assert brent(holed, (0.0, 0.0), -1.0, 1.0, 1e-9, 100)[2] == NOT_A_NUMBER
