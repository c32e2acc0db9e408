"""The polynomial functions against libm, in loops over an array."""

import math

import numpy as np

from abhv_mc.jit import kernel
from abhv_mc.numerics import lane_math
from benchmarks.timing import measure_ratio

N = 4096


@kernel
def exp_own(x, out):
    for i in range(x.size):
        out[i] = lane_math.exp(x[i])


@kernel
def exp_libm(x, out):
    for i in range(x.size):
        out[i] = math.exp(x[i])


@kernel
def log_own(x, out):
    for i in range(x.size):
        out[i] = lane_math.log(x[i])


@kernel
def log_libm(x, out):
    for i in range(x.size):
        out[i] = math.log(x[i])


@kernel
def sincos_own(x, out):
    for i in range(x.size):
        sine, cosine = lane_math.sincos(x[i])
        out[i] = sine + cosine


@kernel
def sincos_libm(x, out):
    for i in range(x.size):
        out[i] = math.sin(x[i]) + math.cos(x[i])


@kernel
def atan2_own(x, out):
    for i in range(x.size):
        out[i] = lane_math.atan2(x[i], 0.5)


@kernel
def atan2_libm(x, out):
    for i in range(x.size):
        out[i] = math.atan2(x[i], 0.5)


PAIRS = {
    "exp": (exp_own, exp_libm),
    "log": (log_own, log_libm),
    "sin and cos": (sincos_own, sincos_libm),
    "atan2": (atan2_own, atan2_libm),
}


def measure_function(name: str) -> float:
    """Time of libm over that of ours."""
    own, libm = PAIRS[name]
    x = np.random.default_rng(1).uniform(0.1, 3.0, N)
    out = np.empty(N)
    return measure_ratio(lambda: libm(x, out), lambda: own(x, out), pairs=200)
