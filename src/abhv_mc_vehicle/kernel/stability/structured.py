"""Upper bound of the structured singular value for complex diagonal blocks.

The upper bound on mu(M) is the minimum over diagonal D of sigma(D M D^-1), which is convex in log
D. The bound equals mu for up to three blocks and nearly equals mu for four (Packard and Doyle,
Automatica 29 (1993) 71-109). The minimization starts from Osborne's balancing and uses BFGS with a
weak Wolfe search, which also works where two singular values coincide (Lewis and Overton, Math.
Program. 141 (2013)).
"""

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Ints
from abhv_mc_vehicle.kernel.jit import kernel, routine

_SWEEPS = 30  # maximum number of sweeps of Jacobi's method, which usually needs five
_STEPS = 60  # maximum number of steps of the descent
_FLAT = 1e-10  # gradient norm at which the descent ends


@routine
def _sigma(M, x, H, V, gradient):
    """Return the log of the largest singular value of exp(x) M exp(-x), and its gradient.

    H and V are buffers; the gradient is filled in place.
    """
    n = M.shape[0]
    # H = N^H N with the scaled matrix N; Jacobi rotations give the eigenvectors of H.
    for i in range(n):
        for j in range(n):
            total = complex(0.0, 0.0)
            for k in range(n):
                total += np.conj(M[k, i]) * M[k, j] * np.exp(2.0 * x[k])
            H[i, j] = total * np.exp(-x[i] - x[j])
            V[i, j] = complex(1.0 if i == j else 0.0, 0.0)
    trace = 0.0
    for i in range(n):
        trace += H[i, i].real
    for _ in range(_SWEEPS):
        off = 0.0
        for i in range(n):
            for j in range(i + 1, n):
                off += H[i, j].real ** 2 + H[i, j].imag ** 2
        if off <= 1e-30 * trace * trace:
            break
        for i in range(n):
            for j in range(i + 1, n):
                size = np.sqrt(H[i, j].real ** 2 + H[i, j].imag ** 2)
                if size <= 1e-18 * trace:
                    continue
                phase = H[i, j] / size
                tau = (H[j, j].real - H[i, i].real) / (2.0 * size)
                t = (1.0 if tau >= 0.0 else -1.0) / (abs(tau) + np.sqrt(1.0 + tau * tau))
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                for k in range(n):
                    a = H[k, i]
                    b = H[k, j] * np.conj(phase)
                    H[k, i] = c * a - s * b
                    H[k, j] = s * a + c * b
                    a = V[k, i]
                    b = V[k, j] * np.conj(phase)
                    V[k, i] = c * a - s * b
                    V[k, j] = s * a + c * b
                for k in range(n):
                    a = H[i, k]
                    b = H[j, k] * phase
                    H[i, k] = c * a - s * b
                    H[j, k] = s * a + c * b
    best = 0
    for i in range(1, n):
        if H[i, i].real > H[best, best].real:
            best = i
    square = max(H[best, best].real, 1e-300)
    # d log sigma / d x_i = |u_i|^2 - |v_i|^2 with the left and right singular vectors.
    for i in range(n):
        total = complex(0.0, 0.0)
        for k in range(n):
            total += M[i, k] * np.exp(x[i] - x[k]) * V[k, best]
        left = (total.real**2 + total.imag**2) / square
        gradient[i] = left - (V[i, best].real ** 2 + V[i, best].imag ** 2)
    return 0.5 * np.log(square)


@routine
def _osborne(M, x):
    """Fill x with log scalings that balance rows and columns, ignoring the diagonal."""
    n = M.shape[0]
    largest = 1e-300
    for i in range(n):
        x[i] = 0.0
        for j in range(n):
            largest = max(largest, M[i, j].real ** 2 + M[i, j].imag ** 2)
    for _ in range(6):
        for i in range(n):
            row = 1e-24 * largest
            column = 1e-24 * largest
            for j in range(n):
                if j != i:
                    row += (M[i, j].real ** 2 + M[i, j].imag ** 2) * np.exp(2.0 * (x[i] - x[j]))
                    column += (M[j, i].real ** 2 + M[j, i].imag ** 2) * np.exp(2.0 * (x[j] - x[i]))
            x[i] += 0.25 * np.log(column / row)
    mean = 0.0
    for i in range(n):
        mean += x[i] / n
    for i in range(n):
        x[i] -= mean


@routine
def _descend(M, x, H, V, room):
    """Minimize log sigma over x, starting at x; ``room`` [6 + n, n] is a buffer."""
    n = M.shape[0]
    g = room[0]
    trial = room[1]
    g_trial = room[2]
    p = room[3]
    y = room[4]
    inverse = room[6:]
    value = _sigma(M, x, H, V, g)
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    first = True
    for _ in range(_STEPS):
        slope = 0.0
        size = 0.0
        for i in range(n):
            total = 0.0
            for j in range(n):
                total -= inverse[i, j] * g[j]
            p[i] = total
            slope += total * g[i]
            size = max(size, abs(g[i]))
        if size < _FLAT or slope > -1e-18:
            break
        low = 0.0
        high = np.inf
        step = 1.0
        candidate = value
        for _ in range(30):
            for i in range(n):
                trial[i] = x[i] + step * p[i]
            candidate = _sigma(M, trial, H, V, g_trial)
            slope_there = 0.0
            for i in range(n):
                slope_there += g_trial[i] * p[i]
            if candidate > value + 1e-4 * step * slope:
                high = step
            elif slope_there < 0.9 * slope:
                low = step
            else:
                break
            step = 0.5 * (low + high) if high < np.inf else 2.0 * low
        if candidate >= value:
            break
        gained = value - candidate
        curvature = 0.0
        square = 0.0
        for i in range(n):
            y[i] = g_trial[i] - g[i]
            curvature += step * p[i] * y[i]
            square += y[i] * y[i]
        if curvature > 1e-300:
            if first:
                for i in range(n):
                    for j in range(n):
                        inverse[i, j] = curvature / square if i == j else 0.0
                first = False
            # The update is inverse <- (1 - s y'/c) inverse (1 - y s'/c) + s s'/c.
            hy = room[5]
            yhy = 0.0
            for i in range(n):
                hy[i] = 0.0
                for j in range(n):
                    hy[i] += inverse[i, j] * y[j]
                yhy += y[i] * hy[i]
            for i in range(n):
                for j in range(n):
                    si = step * p[i]
                    sj = step * p[j]
                    inverse[i, j] += (curvature + yhy) * si * sj / curvature**2 - (
                        hy[i] * sj + si * hy[j]
                    ) / curvature
        for i in range(n):
            x[i], g[i] = trial[i], g_trial[i]
        value = candidate
        if gained < 1e-13:
            break
    return value


@kernel
def _structured(M, x, value):
    n = M.shape[1]
    H = np.empty((n, n), np.complex128)
    V = np.empty((n, n), np.complex128)
    room = np.empty((6 + n, n))
    for k in range(M.shape[0]):
        _osborne(M[k], x[k])
        value[k] = np.exp(_descend(M[k], x[k], H, V, room))


@kernel
def _peak(M, value, peak_index):
    n = M.shape[2]
    H = np.empty((n, n), np.complex128)
    V = np.empty((n, n), np.complex128)
    room = np.empty((6 + n, n))
    x = np.empty(n)
    bound = np.empty(M.shape[1])
    tight = np.empty(M.shape[1], np.int64)
    for system in range(M.shape[0]):
        for f in range(M.shape[1]):
            _osborne(M[system, f], x)
            bound[f] = _sigma(M[system, f], x, H, V, room[0])
            tight[f] = 0
        best = np.argmax(bound)
        for _ in range(M.shape[1]):
            best = np.argmax(bound)
            if tight[best] == 1:
                break
            _osborne(M[system, best], x)
            bound[best] = _descend(M[system, best], x, H, V, room)
            tight[best] = 1
            # The scaling is also good at neighbouring frequencies, so most of them need no descent.
            for f in range(M.shape[1]):
                if bound[f] > bound[best] and tight[f] == 0:
                    bound[f] = min(bound[f], _sigma(M[system, f], x, H, V, room[0]))
        value[system] = np.exp(bound[best])
        peak_index[system] = best


LAST_COMPILED = _structured  # last kernel that is compiled for stability margins


def structured_singular_values(M: NDArray[np.complex128]) -> Floats:
    """Return upper bounds [point] on mu of matrices [point, n, n] with complex scalar blocks."""
    matrices = np.ascontiguousarray(M, np.complex128)
    value = np.empty(len(matrices))
    _structured(matrices, np.empty(matrices.shape[:2]), value)
    return value


def peak_of_structured_singular_values(M: NDArray[np.complex128]) -> tuple[Floats, Ints]:
    """Return each system's largest bound [system] and the index of its frequency.

    ``M`` has shape [system, frequency, n, n].
    """
    matrices = np.ascontiguousarray(M, np.complex128)
    value = np.empty(len(matrices))
    peak_index = np.empty(len(matrices), np.int64)
    _peak(matrices, value, peak_index)
    return value, peak_index
