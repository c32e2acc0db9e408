"""Frequency responses of sampled loops, many at once, by solving systems in Hessenberg form.

Transfer functions of the 18- to 36-state models have polynomials whose roots mean nothing in double precision; a linear
system for each frequency keeps nearly all digits. Laub, IEEE Trans. Automatic Control 26 (1981) 407-408.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc.kernel.stability.loop_gains import fill_loop_gains
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
    plant = to_hessenberg(linear.A, linear.B, linear.sense)
    law = to_hessenberg(linear.law_A, linear.law_B, np.where(closes, linear.law_C, 0.0))
    law_D = np.where(closes, linear.law_D, 0.0)
    return Loops(*plant, *law, np.ascontiguousarray(law_D), linear.delay, linear.period)


def to_hessenberg(A: Floats, B: Floats, C: Floats) -> tuple[Floats, Floats, Floats]:
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
    """L [point, input, input] of ``system`` at ``omega`` (rad/s), cut at the plant's inputs: the law commands -L v."""
    points, inputs = len(omega), loops.law_D.shape[1]
    result = np.empty((points, inputs, inputs), dtype=np.complex128)
    fill_loop_gains(*loops[:8], np.asarray(system, np.int64), np.asarray(omega * loops.period, np.float64), result)
    return result
