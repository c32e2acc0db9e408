"""Frequency responses of sampled loops, by solving a Hessenberg system at each frequency."""

import numpy as np

from abhv_mc_vehicle.kernel.jit import kernel


@kernel
def fill_loop_gains(
    plant_A, plant_B, plant_C, law_A, law_B, law_C, law_D, delay, system, angle, result
):
    """Fill ``result`` [point, input, input] with the loop gains of all points.

    ``angle`` [point] is the frequency in rad per control period. The other arguments are described
    in ``stability.margins``.
    """
    n = plant_A.shape[1]
    m = law_A.shape[1]
    inputs = law_D.shape[1]
    outputs = law_D.shape[2]
    work = np.empty((max(n, m), max(n, m)), np.complex128)
    x = np.empty((max(n, m), inputs), np.complex128)
    y = np.empty((outputs, inputs), np.complex128)
    for point in range(angle.size):
        p = system[point]
        z = complex(np.cos(angle[point]), np.sin(angle[point]))
        late = angle[point] * delay[p]
        shift = complex(np.cos(late), -np.sin(late))
        for block in range(2):
            A = plant_A[p] if block == 0 else law_A[p]
            size = n if block == 0 else m
            # The right-hand side contains plant inputs, or plant outputs that the law receives.
            for i in range(size):
                for k in range(inputs):
                    total = complex(0.0, 0.0)
                    if block == 0:
                        total += plant_B[p, i, k]
                    else:
                        for j in range(outputs):
                            total += law_B[p, i, j] * y[j, k]
                    x[i, k] = total
            # (z - A) x = b is solved by elimination; the pivot is the larger of two adjacent rows.
            for i in range(size):
                for j in range(max(i - 1, 0), size):
                    work[i, j] = -A[i, j]
                work[i, i] += z
            for i in range(size - 1):
                pivot = work[i, i]
                below = work[i + 1, i]
                if abs(below.real) + abs(below.imag) > abs(pivot.real) + abs(pivot.imag):
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
            if block == 0:
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
