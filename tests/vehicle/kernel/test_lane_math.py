"""Lane math against mpmath and against plain Python, and its vectorization."""

import math
import re
import runpy
from pathlib import Path

import mpmath
import numba
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from abhv_mc_vehicle.kernel.numerics import lane_math

N = 3000
mpmath.mp.prec = 160


def _ulps(got, exact):
    return float(abs(mpmath.mpf(got) - exact) / mpmath.mpf(math.ulp(float(exact))))


def _signed_decades(generator, low, high):
    return generator.choice([-1.0, 1.0], N) * 10.0 ** generator.uniform(low, high, N)


def _samples(name):
    g = np.random.default_rng(20240501)
    return {
        "exp": [(g.uniform(-1, 1, N),), (g.uniform(-708, 709.7, N),), (g.uniform(-745, -708, N),)],
        "log": [
            (10 ** g.uniform(-308, 308, N),),
            (g.uniform(0.5, 2, N),),
            (1 + _signed_decades(g, -15, -3),),
        ],
        "sin": [
            (g.uniform(-4, 4, N),),
            (g.uniform(-1e5, 1e5, N),),
            (_signed_decades(g, -300, 0),),
            (np.round(g.uniform(0, 63661, N)) * (math.pi / 2),),
        ],
        "asin": [
            (g.uniform(-1, 1, N),),
            (_signed_decades(g, -20, 0),),
            (1 - 10 ** g.uniform(-16, 0, N),),
        ],
        "tan": [(g.uniform(-1.57, 1.57, N),)],
        "atan2": [
            (g.uniform(-1, 1, N), g.uniform(-1, 1, N)),
            (_signed_decades(g, -3, 3), _signed_decades(g, -3, 3)),
            (_signed_decades(g, -100, 100), _signed_decades(g, -100, 100)),
        ],
        "reciprocals": [
            (_signed_decades(g, -3, 3), _signed_decades(g, -3, 3)),
            (_signed_decades(g, -150, 150), _signed_decades(g, -150, 150)),
        ],
        "two_angles": [tuple(g.uniform(-1, 1, N) for _ in range(4))],
        "power": [(10 ** g.uniform(-1, 1, N), g.uniform(-0.4, 0.4, N))],
    }[{"cos": "sin", "acos": "asin"}.get(name, name)]


# Compiled, exact, and the tolerance in ulps; measured 0.99, 0.74, 0.76, 0.76, 2.2, 1.9, 2.1, 1.7,
# 1.8.
CASES = {
    "exp": (lane_math.exp, mpmath.exp, 1),
    "log": (lane_math.log, mpmath.log, 1),
    "sin": (lambda x: lane_math.sincos(x)[0], mpmath.sin, 1),
    "cos": (lambda x: lane_math.sincos(x)[1], mpmath.cos, 1),
    "tan": (lane_math.tan, mpmath.tan, 2.5),
    "asin": (lane_math.asin, mpmath.asin, 2),
    "acos": (lane_math.acos, mpmath.acos, 2.5),
    "atan2": (lane_math.atan2, mpmath.atan2, 2),
    "power": (lane_math.power, mpmath.power, 2.5),
    "reciprocals": (lambda x, y: lane_math.reciprocals(x, y)[1], lambda x, y: 1 / mpmath.mpf(y), 2),
    "two_angles": (
        lambda *x: lane_math.two_angles(*x)[1],
        lambda y_1, x_1, y_2, x_2: mpmath.atan2(y_2, x_2),
        4,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_within_stated_ulps_of_mpmath(name):
    function, exact, allowed = CASES[name]
    for sample in _samples(name):
        assert max(_ulps(function(*x), exact(*x)) for x in np.array(sample).T.tolist()) <= allowed


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
@pytest.mark.parametrize("name", sorted({*CASES, "sincos"} - {"sin", "cos"}))
def test_plain_python_gives_the_same_bits(name):
    compiled = getattr(lane_math, name)
    for sample in _samples({"sincos": "sin"}.get(name, name)):
        for x in np.array(sample).T[:500].tolist():
            # repr distinguishes all doubles, also -0.0
            assert repr(compiled(*x)) == repr(compiled.py_func(*x)), x


SPECIAL = [
    0.0,
    -0.0,
    5e-324,
    1e-310,
    -1e-310,
    1.0,
    -1.0,
    1e22,
    -1e22,
    1.7e308,
    math.inf,
    -math.inf,
    math.nan,
]


@pytest.mark.parametrize("x", SPECIAL)
def test_exp_and_log_of_special_values(x):
    with np.errstate(all="ignore"):
        exp, log = float(np.exp(x)), float(np.log(x))
    for compiled, expected in ((lane_math.exp, exp), (lane_math.log, log)):
        np.testing.assert_array_max_ulp(np.array(compiled(x)), np.array(expected), 1)
        assert repr(compiled(x)) == repr(getattr(compiled, "py_func", compiled)(x))


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -1.0, 1e-300, math.inf, -math.inf])
@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -1.0, -1e-300, math.inf, -math.inf])
def test_atan2_quadrants_and_signed_zeros(y, x):
    angle = lane_math.atan2(y, x)
    if math.isinf(x) and math.isinf(y):
        assert math.isnan(angle)
    else:
        assert angle == pytest.approx(math.atan2(y, x), rel=4e-16, abs=0.0)
        assert math.copysign(1.0, angle) == math.copysign(1.0, math.atan2(y, x))


def test_sine_and_arcs_at_and_beyond_the_ends_of_their_domains():
    assert lane_math.sincos(0.0) == lane_math.sincos(-0.0) == (0.0, 1.0)
    for x in (math.inf, -math.inf, math.nan, 1.1e6, 1e300):
        assert all(math.isnan(value) for value in lane_math.sincos(x))
    above = math.nextafter(1.0, 2.0)
    assert [lane_math.asin(x) for x in (-above, 1.0, above)] == [
        -math.pi / 2,
        math.pi / 2,
        math.pi / 2,
    ]
    assert [lane_math.acos(x) for x in (-above, 1.0, above)] == [math.pi, 0.0, 0.0]
    assert math.isnan(lane_math.asin(math.nan))


@given(st.tuples(*[st.floats(0.5, 1.0), st.floats(-1.0, 1.0)] * 2))
@example((1.0, -0.0, 1.0, 0.0))
def test_shallow_angles_are_two_angles_bit_for_bit(points):
    x_1, slope_1, x_2, slope_2 = points
    y_1, y_2 = (
        slope * lane_math.TAN_EIGHTH_PI * x for slope, x in ((slope_1, x_1), (slope_2, x_2))
    )
    if lane_math.is_shallow(y_1, x_1) and lane_math.is_shallow(y_2, x_2):
        shallow = lane_math.shallow_angles(y_1, x_1, y_2, x_2)
        assert repr(shallow) == repr(lane_math.two_angles(y_1, x_1, y_2, x_2))


def test_coefficients_are_the_fits():
    fit = runpy.run_path(str(Path(__file__).parents[2] / "reference" / "fit_lane_math.py"))["fit"]()
    for name, values in fit.items():
        assert vars(lane_math).get(name, vars(lane_math).get(f"_{name}")) == values


@numba.njit(forceinline=True, error_model="numpy")
def _everything(x, y):
    sine, cosine = lane_math.sincos(x)
    return (
        lane_math.atan2(sine, cosine)
        + lane_math.power(y, x)
        + lane_math.asin(sine)
        + lane_math.tan(y)
    )


@numba.njit(error_model="numpy")
def _lane_loop(x, y):
    inputs = np.empty((2, 64))  # local blocks, which do not overlap
    outputs = np.empty(64)
    inputs[:] = x
    first, second = inputs[0], inputs[1]
    for lane in range(64):
        outputs[lane] = _everything(first[lane], second[lane])
    y[:] = outputs


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_loop_over_lanes_becomes_simd_and_keeps_the_bits():
    x = np.random.default_rng(7).uniform(0.1, 1.5, (2, 64))
    y = np.empty(64)
    _lane_loop(x, y)
    (code,) = _lane_loop.inspect_llvm().values()
    assert len(re.findall(r"fmul <\d+ x double>", code)) > 50
    assert len(re.findall(r"fdiv <\d+ x double>", code)) >= 4
    assert y.tolist() == [_everything(*map(float, column)) for column in x.T]
