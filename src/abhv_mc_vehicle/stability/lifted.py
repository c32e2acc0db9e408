"""Margins of multi-rate controllers from responses lifted over the controller's period.

A controller that repeats after N ticks of duration T responds to a frequency w with all frequencies
w + 2 pi m / (N T), m = 0 .. N - 1: a loop gain is a matrix over these harmonics. A constant gain
factor at an actuator is a multiple of the identity, so a single loop, with the other loops closed,
has N characteristic loci instead of one (Bittanti and Colaneri, Periodic Systems, 2009, chapters 2
and 6). If all ticks are equal, the margins equal those of a single-rate controller.

Responses are computed from the N inputs to the N commands of a period. These responses are related
to the responses between harmonics by a unitary transformation, have the same loci and norms, and
are cheaper to compute.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc_vehicle.stability.linearize import open_loop
from abhv_mc_vehicle.stability.margins import (
    Linear,
    Loops,
    Margins,
    eigenvalues,
    gain_margins,
    inverse,
    largest,
    loop_gains,
    phase_margins,
    to_hessenberg,
)
from abhv_mc_vehicle.stability.search import refine_peaks

# frequency used instead of zero, where the response of integrators is infinite, rad/s
_SLOWEST = 1e-6
_ROUNDING = 1e-13  # relative size below which a locus counts as zero
_NEWTON_STEPS = 12


class _Lifted(NamedTuple):
    """Lifted loops of k inputs, from the inputs in a period's N ticks to negated commands."""

    loops: Loops
    ahead: Floats  # [system, k N, k N] effect of a command on later commands in the same period
    ticks: int
    period: float  # duration of a tick, s


def find_lifted_margins(linear: Linear, system: int, omega: Floats) -> Margins:
    """Return the margins of one system; `omega` [frequency] increases to pi / (N T)."""
    every, single = _lift(linear, system)
    rows = np.arange(len(linear.inputs))
    eye = np.eye(single.ticks)
    grid = np.tile(omega, (rows.size, 1))
    shape = (rows.size, omega.size, *eye.shape)
    L = _gains(single, np.repeat(rows, omega.size), grid.ravel()).reshape(shape)
    S = inverse(eye + L)

    def farthest(centre: float) -> Floats:
        c = centre * eye
        return largest(
            lambda i, w: _norm(inverse(eye + _gains(single, i, w)) - c), grid, _norm(S - c)
        )

    gain = gain_margins(
        lambda i, w: _loci(_gains(single, i, w)), grid, _loci(L), single.period * single.ticks
    )
    for k, frequency in (gain[:2], gain[2:]):
        some = np.flatnonzero(np.isfinite(frequency))
        frequency[some] = np.abs(
            _harmonic(single, some, frequency[some], np.asarray(-1.0 / k[some], np.complex128))
        )
    phase = _phase_margins(single, grid, L)
    all_L = _gains(every, 0 * rows[:1], omega)
    mu, mu_at = _largest_scaled(every, omega, all_L, rows.size)
    together = _phase_margins(every, omega[None], all_L[None])[2]
    loop_margins = (*gain, *phase, farthest(0.0), 1.0 / farthest(0.5))
    return Margins._make([*(values[None] for values in loop_margins), 1.0 / mu, mu_at, together])


def fundamental_gains(linear: Linear, omega: Floats) -> Complexes:
    """Return the loop gains [frequency, loop] of the first system, without harmonics."""
    _, single = _lift(linear, 0)
    rows = np.arange(len(linear.inputs))
    return np.stack([_in_harmonics(single, rows[[i]], omega)[:, 0, 0] for i in rows], axis=1)


def _lift(linear: Linear, system: int) -> tuple[_Lifted, _Lifted]:
    """Return all loops of a system together, and each loop with the others closed."""
    closes = (linear.cut[system] == 0)[:, None]
    inputs = np.arange(len(linear.inputs))
    ticks = [
        (A, B, closes * C) for A, B, C in (open_loop(phase, system) for phase in linear.phases)
    ]
    alone = [
        [(A - B @ np.where((inputs == i)[:, None], 0.0, C), B[:, [i]], C[[i]]) for A, B, C in ticks]
        for i in inputs
    ]
    return _over_ticks([ticks], linear.period), _over_ticks(alone, linear.period)


def _over_ticks(systems: list[list[tuple[Floats, Floats, Floats]]], period: float) -> _Lifted:
    """Return the lifted loops of systems, given A, B and C in each tick."""
    parts = []
    for ticks in systems:
        n, k = ticks[0][1].shape
        count = len(ticks)
        state = np.eye(n)
        driven = np.zeros((n, k, count))
        out = []
        ahead = []
        for tick, (A, B, C) in enumerate(ticks):
            out.append(C @ state)
            ahead.append(np.tensordot(C, driven, 1))
            state = A @ state
            driven = np.tensordot(A, driven, 1)
            driven[:, :, tick] = B
        flat = (state, driven.reshape(n, -1), np.stack(out, 1).reshape(-1, n), np.stack(ahead, 1))
        parts.append((*flat[:3], flat[3].reshape(k * count, -1)))
    A, B, C, D = (np.stack(matrices) for matrices in zip(*parts, strict=True))
    s, size = D.shape[:2]
    no = np.zeros((s, 0, 0)), np.zeros((s, 0, size)), np.zeros((s, size, 0))
    minus = np.tile(-np.eye(size), (s, 1, 1))
    loops = Loops(*to_hessenberg(A, B, C), *no, minus, np.zeros(s, np.int64), period * count)
    return _Lifted(loops, D, count, period)


def _gains(law: _Lifted, system: Ints, omega: Floats) -> Complexes:
    """Return loop gains [point, k N, k N] from actuator inputs to the negated commands."""
    system = system + np.zeros(omega.size, np.int64)
    return loop_gains(law.loops, system, np.maximum(omega, _SLOWEST)) + law.ahead[system]


def _harmonics(law: _Lifted, omega: Floats) -> Floats:
    """Return the frequencies [point, harmonic] within +-pi / T excited by `omega`."""
    m = (np.arange(law.ticks) + (law.ticks - 1) // 2) % law.ticks - (law.ticks - 1) // 2
    return omega[:, None] + 2.0 * np.pi / (law.ticks * law.period) * m


def _in_harmonics(law: _Lifted, system: Ints, omega: Floats) -> Complexes:
    """Return the loop gains between harmonics instead of ticks, by a unitary transformation."""
    L = _gains(law, system, omega)
    count = law.ticks
    loops = L.shape[-1] // count
    ticks = L.reshape(omega.size, loops, count, loops, count).swapaxes(2, 3)
    wave = np.exp(1j * law.period * _harmonics(law, omega)[:, None, :] * np.arange(count)[:, None])[
        :, None, None
    ]
    return (wave.conj().swapaxes(-1, -2) @ ticks @ wave / count).swapaxes(2, 3).reshape(L.shape)


def _harmonic(law: _Lifted, system: Ints, omega: Floats, locus: Complexes) -> Floats:
    """Return the dominant frequency in the eigenvector of a locus [point], rad/s."""
    values, vectors = np.linalg.eig(_in_harmonics(law, system, omega))
    share = np.abs(inverse(vectors) * np.swapaxes(vectors, -1, -2))
    points = np.arange(omega.size)
    nearest = np.abs(values - locus[:, None]).argmin(axis=1)
    share = share[points, nearest].reshape(omega.size, values.shape[1] // law.ticks, law.ticks)
    content = share.sum(axis=1)
    return _harmonics(law, omega)[points, content.argmax(axis=1)]


def _loci(matrices: Complexes) -> Complexes:
    """Return the eigenvalues [..., locus]; those below the rounding error are set to zero."""
    values, vectors = np.linalg.eig(matrices)
    condition = np.linalg.norm(inverse(vectors), axis=-1)
    size = np.linalg.norm(matrices, axis=(-2, -1))[..., None]
    return np.where(np.abs(values) > _ROUNDING * condition * size, values, 0.0)


def _phase_margins(law: _Lifted, grid: Floats, L: Complexes) -> tuple[Floats, Floats, Floats]:
    return phase_margins(
        lambda i, w: eigenvalues(_gains(law, i, w)), grid, eigenvalues(L), partial(_delays, law)
    )


def _delays(law: _Lifted, system: Ints, omega: Floats, locus: Complexes) -> tuple[Floats, Floats]:
    """Return frequencies at which loci have magnitude 1, and delays that turn the loci to -1.

    Frequencies and delays are computed by Newton's method.
    """

    def left(x: Floats) -> Floats:
        w = np.exp(x[:, 0])
        L = _in_harmonics(law, system, w)
        late = np.exp(-1j * _harmonics(law, w) * x[:, 1:])
        values = 1.0 + eigenvalues(L * np.tile(late, L.shape[-1] // law.ticks)[:, None])
        nearest = values[np.arange(len(x)), np.abs(values).argmin(axis=1)]
        return np.column_stack([nearest.real, nearest.imag])

    harmonic = _harmonic(law, system, omega, locus)
    turn = np.angle(locus) + np.pi
    guess = np.where(harmonic > 0.0, turn, 2.0 * np.pi - turn) / np.abs(harmonic)
    x = np.column_stack([np.log(omega), guess])
    small_step = np.full(omega.size, 1e-7)
    for _ in range(_NEWTON_STEPS):
        f = left(x)
        if np.abs(f).max(initial=0.0) < 1e-11:
            break
        steps = (
            np.column_stack([small_step, 0.0 * small_step]),
            np.column_stack([0.0 * small_step, small_step * x[:, 1]]),
        )
        J = np.stack(
            [(left(x + d) - left(x - d)) / (2.0 * d.sum(axis=1))[:, None] for d in steps], axis=2
        )
        x = x - np.clip(np.einsum("pij,pj->pi", np.linalg.pinv(J), f), -1.0, 1.0)
    is_converged = (np.abs(left(x)).max(axis=1) < 1e-6) & (x[:, 1] > 0.0)
    return np.abs(harmonic), np.where(is_converged, x[:, 1], guess)


def _norm(matrices: Complexes) -> Floats:
    return np.linalg.norm(matrices, 2, axis=(-2, -1))


def _largest_scaled(
    law: _Lifted, omega: Floats, L: Complexes, inputs: int
) -> tuple[Floats, Floats]:
    """Return the peak of the scaled norm of M = S - I/2, and its frequency.

    The scaled norm is the smallest norm of D M D^-1 over diagonal D with one scale per input.
    """
    eye = np.eye(L.shape[-1])
    M = inverse(eye + L) - 0.5 * eye
    bounds = np.linalg.norm(M, axis=(1, 2))
    scales = np.zeros(inputs)
    tight = np.zeros(omega.size, bool)
    while not tight[best := int(bounds.argmax())]:
        bounds[best], scales = _least_norm(M[best], scales)
        tight[best] = True
        open_points = np.flatnonzero(~tight & (bounds > bounds[best]))
        bounds[open_points] = np.minimum(
            bounds[open_points], _norm(_scaled(M[open_points], scales))
        )

    def size(system: Ints, w: Floats) -> Floats:
        responses = inverse(eye + _gains(law, system, w)) - 0.5 * eye
        return np.array([_least_norm(response, scales)[0] for response in responses])

    return refine_peaks(size, omega[None], np.array([best]), bounds[[best]])


def _scaled(M: Complexes, log_scales: Floats) -> Complexes:
    d = np.exp(np.repeat(log_scales, M.shape[-1] // len(log_scales)))
    return d[:, None] * M / d


def _least_norm(M: Complexes, start: Floats) -> tuple[float, Floats]:
    """Return the smallest norm of D M D^-1, and the log scales in D, by convex minimization."""
    from scipy.optimize import minimize

    def norm(x: Floats) -> tuple[float, Floats]:
        u, size, v = np.linalg.svd(_scaled(M, x))
        slope = np.abs(u[:, 0]) ** 2 - np.abs(v[0]) ** 2
        return float(np.log(size[0])), slope.reshape(len(x), -1).sum(axis=1)

    optimum = minimize(norm, start, jac=True, method="BFGS")
    return float(np.exp(optimum.fun)), optimum.x
