"""Frequency responses of sampled loops, many at once, by solving systems in Hessenberg form.

Transfer functions of the 18- to 36-state models have polynomials whose roots mean nothing in double precision; a linear
system for each frequency keeps nearly all digits. Laub, IEEE Trans. Automatic Control 26 (1981) 407-408.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc.jit import kernel
from abhv_mc.stability.linearize import Linear


class Loops(NamedTuple):
    """Plant and law of each system, their A in Hessenberg form."""

    plant_A: Floats  # [system, n, n]
    plant_B: Floats  # [system, n, input]
    plant_C: Floats  # [system, output, n]
    law_A: Floats  # [system, m, m]
    law_B: Floats  # [system, m, output]
    law_C: Floats  # [system, input, m]
    law_D: Floats  # [system, input, output]
    delay: Ints  # [system] control periods
    period: float  # s


def make_loops(linear: Linear) -> Loops:
    """The loops of linear models."""
    closes = (linear.cut == 0)[:, :, None]  # what commands a stuck surface belongs to no loop
    plant = _hessenberg(linear.A, linear.B, linear.sense)
    law = _hessenberg(linear.law_A, linear.law_B, np.where(closes, linear.law_C, 0.0))
    law_D = np.where(closes, linear.law_D, 0.0)
    return Loops(*plant, *law, np.ascontiguousarray(law_D), linear.delay, linear.period)


def _hessenberg(A: Floats, B: Floats, C: Floats) -> tuple[Floats, Floats, Floats]:
    """The same systems in coordinates in which A has but one diagonal below the main one."""
    from scipy.linalg import hessenberg

    if A.shape[1] == 0:
        return A.copy(), B.copy(), C.copy()
    A, B, C = A.copy(), B.copy(), C.copy()
    for i in range(len(A)):
        A[i], Q = hessenberg(A[i], calc_q=True)
        B[i], C[i] = Q.T @ B[i], C[i] @ Q
    return A, B, C


def loop_gains(loops: Loops, system: Ints, omega: Floats) -> Complexes:
    """L [point, input, input] of ``system`` [point] at ``omega`` [point] (rad/s), all loops cut at the plant's inputs.

    The law commands ``u = -L v`` when ``v`` goes into the plant.
    """
    points, inputs = len(omega), loops.law_D.shape[1]
    result = np.empty((points, inputs, inputs), dtype=np.complex128)
    _loop_gains(*loops[:8], np.asarray(system, np.int64), np.asarray(omega * loops.period, np.float64), result)
    return result


@kernel
def _loop_gains(plant_A, plant_B, plant_C, law_A, law_B, law_C, law_D, delay, system, turn, result):
    n, m = plant_A.shape[1], law_A.shape[1]
    inputs, outputs = law_D.shape[1], law_D.shape[2]
    work = np.empty((max(n, m), max(n, m)), np.complex128)
    x = np.empty((max(n, m), inputs), np.complex128)
    y = np.empty((outputs, inputs), np.complex128)
    for point in range(turn.size):
        p = system[point]
        z = complex(np.cos(turn[point]), np.sin(turn[point]))
        late = turn[point] * delay[p]
        shift = complex(np.cos(late), -np.sin(late))
        for part in range(2):
            A = plant_A[p] if part == 0 else law_A[p]
            size = n if part == 0 else m
            # Right-hand side: the plant's inputs, or what the law makes of the plant's outputs.
            for i in range(size):
                for k in range(inputs):
                    total = complex(0.0, 0.0)
                    if part == 0:
                        total += plant_B[p, i, k]
                    else:
                        for j in range(outputs):
                            total += law_B[p, i, j] * y[j, k]
                    x[i, k] = total
            # (z - A) x = b by elimination with the row below, whichever of both has the larger pivot.
            for i in range(size):
                for j in range(max(i - 1, 0), size):
                    work[i, j] = -A[i, j]
                work[i, i] += z
            for i in range(size - 1):
                here, below = work[i, i], work[i + 1, i]
                if abs(below.real) + abs(below.imag) > abs(here.real) + abs(here.imag):
                    for j in range(i, size):
                        work[i, j], work[i + 1, j] = work[i + 1, j], work[i, j]
                    for k in range(inputs):
                        x[i, k], x[i + 1, k] = x[i + 1, k], x[i, k]
                if work[i, i] == 0.0:
                    work[i, i] = 1e-300
                factor = work[i + 1, i] / work[i, i]
                for j in range(i + 1, size):
                    work[i + 1, j] -= factor * work[i, j]
                for k in range(inputs):
                    x[i + 1, k] -= factor * x[i, k]
            for i in range(size - 1, -1, -1):
                if work[i, i] == 0.0:
                    work[i, i] = 1e-300
                inverse = 1.0 / work[i, i]
                for k in range(inputs):
                    total = x[i, k]
                    for j in range(i + 1, size):
                        total -= work[i, j] * x[j, k]
                    x[i, k] = total * inverse
            if part == 0:
                for j in range(outputs):
                    for k in range(inputs):
                        total = complex(0.0, 0.0)
                        for i in range(size):
                            total += plant_C[p, j, i] * x[i, k]
                        y[j, k] = total * shift
            else:
                for i in range(inputs):
                    for k in range(inputs):
                        total = complex(0.0, 0.0)
                        for j in range(size):
                            total += law_C[p, i, j] * x[j, k]
                        for j in range(outputs):
                            total += law_D[p, i, j] * y[j, k]
                        result[point, i, k] = -total
