"""Margins of laws of several rates, from the responses of their loops lifted over the law's whole period.

A law that repeats after N ticks of T answers a frequency w with all of w + 2 pi m / (N T), m = 0 .. N - 1: a loop gain
is a matrix over these harmonics. A factor of an actuator in every tick is a number times the identity there, so that a
loop alone, the others closed, has N characteristic loci in place of one. Bittanti and Colaneri, Periodic Systems
(2009), chapters 2 and 6. A law that does the same in every tick has the margins of a single rate.

Responses are those from the N inputs to the N commands of a period: a unitary change away from the harmonics, with the
same loci and norms, and what costs least.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc.stability.linearize import Linear, open_loop
from abhv_mc.stability.margins import Closed, Margins, gain_margins, log_size
from abhv_mc.stability.responses import Loops, loop_gains, to_hessenberg
from abhv_mc.stability.search import changes_of_sign, refine_crossings, refine_peaks

_SLOWEST = 1e-6  # rad/s, in place of zero, where integrators have no response
_ROUNDING = 1e-13  # of a matrix times a locus' condition: a smaller locus is taken for zero
_NEWTON_STEPS = 12


class _Law(NamedTuple):
    """Plant and law over a period, from N ticks' inputs to minus N ticks' commands, input by input."""

    every: Loops  # of all loops at once
    ahead: Floats  # [1, 4 N, 4 N] what a command does to those later in its own period
    single: Loops  # of each loop, the others closed
    single_ahead: Floats  # [4, N, N]
    period: float  # s, of a tick
    ticks: int


Matrices = Callable[[Floats], Complexes]  # square ones at frequencies


def find_lifted_margins(linear: Linear, system: int, omega: Floats) -> Margins:
    """Margins of one system at frequencies ``omega`` [frequency] (rising to pi / (N T)) to look at first."""
    law = _make_law(linear, system)
    inputs = len(law.single_ahead)
    margins = np.transpose([_margins_alone(law, i, omega) for i in range(inputs)])
    L, half = _all(law, omega), 0.5 * np.eye(inputs * law.ticks)
    mu, mu_at = _largest_scaled(lambda w: _sensitivity(_all(law, w)) - half, _sensitivity(L) - half, omega, inputs)
    together = _phase_and_delay(lambda w: _all(law, w), np.asarray(np.linalg.eigvals(L)), omega, law)[2]
    return Margins._make([*margins[:, None], *(np.array([v]) for v in (1 / mu, mu_at, together))])


def _margins_alone(law: _Law, loop: int, omega: Floats) -> tuple[float, ...]:
    """The first nine of Margins of one loop, the others closed."""

    def of(w: Floats) -> Complexes:
        return _alone(law, np.full(w.size, loop), w)

    L, eye = of(omega), np.eye(law.ticks)

    def largest(centre: float) -> float:
        size = _norm(_sensitivity(L) - centre * eye)
        at = np.array([size.argmax()])
        found, _ = refine_peaks(lambda _, w: _norm(_sensitivity(of(w)) - centre * eye), omega[None], at, size[at])
        return float(found[0])

    values = _eigenvalues(L, 0)[0]
    gains = _gain_margins(of, _follow(values), omega, law)
    return (*gains, *_phase_and_delay(of, values, omega, law), largest(0.0), 1.0 / largest(0.5))


def fundamental_gains(linear: Linear, omega: Floats) -> Complexes:
    """Gains [frequency, loop] of the first system's loops at the frequency itself, its harmonics left out."""
    law = _make_law(linear, 0)
    alone = (_alone(law, np.full(omega.size, i), omega) for i in range(len(law.single_ahead)))
    return np.stack([_in_harmonics(law, each, omega)[:, 0, 0] for each in alone], axis=1)


def _make_law(linear: Linear, system: int) -> _Law:
    closes = (linear.cut[system] == 0)[:, None]
    ticks = [(A, B, closes * C) for A, B, C in (_open_tick(phase, system) for phase in linear.phases)]
    inputs, span = np.arange(len(closes)), linear.period * len(ticks)
    closed = [[(A - B @ np.where((inputs == i)[:, None], 0.0, C), B, C) for A, B, C in ticks] for i in inputs]
    every, single = _lift([ticks], [inputs], span), _lift(closed, list(inputs[:, None]), span)
    return _Law(*every, *single, linear.period, len(ticks))


def _open_tick(linear: Linear, system: int) -> tuple[Floats, Floats, Floats]:
    """As ``open_loop``, with the measurement's delay before the plant: it has fewer inputs than measurements."""
    A, B, C = open_loop(linear._replace(delay=0 * linear.delay), system)
    (n, k), late = B.shape, B.shape[1] * int(linear.delay[system])
    if late == 0:
        return A, B, C
    older = np.eye(late, late + k, k)[:, :late].T  # what goes in at this tick first
    return (
        np.block([[A, np.zeros((n, late - k)), B], [np.zeros((late, n)), older]]),
        np.eye(n + late, k, -n),
        np.hstack([C, np.zeros((k, late))]),
    )


def _lift(systems: list[list[tuple[Floats, Floats, Floats]]], chosen: list[Ints], span: float) -> tuple[Loops, Floats]:
    """Loops of systems of A, B, C of each tick at their ``chosen`` inputs, and what is ahead within the period."""
    parts = []
    for ticks, cut in zip(systems, chosen, strict=True):
        n, count = len(ticks[0][0]), len(ticks)
        state, driven = np.eye(n), np.zeros((n, len(cut), count))
        out, ahead = [], []
        for k, (A, B, C) in enumerate(ticks):
            out.append(C[cut] @ state)
            ahead.append(np.tensordot(C[cut], driven, 1))
            state, driven = A @ state, np.tensordot(A, driven, 1)
            driven[:, :, k] = B[:, cut]
        size = len(cut) * count
        wide = (state, driven.reshape(n, size), np.stack(out, 1).reshape(size, n))
        parts.append((*wide, np.stack(ahead, 1).reshape(size, size)))
    A, B, C, D = (np.stack(each) for each in zip(*parts, strict=True))
    s, size = D.shape[:2]
    no = np.zeros((s, 0, 0)), np.zeros((s, 0, size)), np.zeros((s, size, 0))
    minus = np.tile(-np.eye(size), (s, 1, 1))
    return Loops(*to_hessenberg(A, B, C), *no, minus, np.zeros(s, np.int64), span), D


def _harmonics(law: _Law, omega: Floats) -> Floats:
    """Frequencies [f, harmonic] between - and + pi / T that answer ``omega`` [f]."""
    m = (np.arange(law.ticks) + (law.ticks - 1) // 2) % law.ticks - (law.ticks - 1) // 2
    return np.asarray(omega[:, None] + 2.0 * np.pi / (law.ticks * law.period) * m)


def _all(law: _Law, omega: Floats) -> Complexes:
    """Loop gain [f, 4 N, 4 N] from what goes into the actuators in a period to minus the commands."""
    return loop_gains(law.every, np.zeros(omega.size, np.int64), omega) + law.ahead


def _alone(law: _Law, loop: Ints, omega: Floats) -> Complexes:
    """Gain [f, N, N] of loops [f], the others closed."""
    return loop_gains(law.single, loop, omega) + law.single_ahead[loop]


def _in_harmonics(law: _Law, matrices: Complexes, omega: Floats) -> Complexes:
    """Matrices [f, k N, k N] from harmonics to harmonics in place of from ticks to ticks: a unitary change."""
    count = law.ticks
    ticks = matrices.reshape(omega.size, -1, count, matrices.shape[-1] // count, count).swapaxes(2, 3)
    wave = np.exp(1j * law.period * _harmonics(law, omega)[:, None, :] * np.arange(count)[:, None])[:, None, None]
    return np.asarray((wave.conj().swapaxes(-1, -2) @ ticks @ wave / count).swapaxes(2, 3).reshape(matrices.shape))


def _sensitivity(L: Complexes) -> Complexes:
    eye = np.eye(L.shape[-1])
    return _solve(eye + L, np.broadcast_to(eye, L.shape))


def _solve(A: Complexes, b: Complexes) -> Complexes:
    """Solutions of systems [..., n, n]; where one of them is singular, of all of them slightly moved."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.solve(A + 1e-14 * np.eye(A.shape[-1]), b))


def _norm(matrices: Complexes) -> Floats:
    return np.asarray(np.linalg.norm(matrices, 2, axis=(-2, -1)))


def _follow(values: Complexes) -> Complexes:
    """Loci [locus, f] of eigenvalues [f, locus], each followed from one frequency to the next."""
    from scipy.optimize import linear_sum_assignment

    values = values.copy()
    for last, here in pairwise(values):
        apart = np.abs(here - last[:, None]) / (np.abs(here) + np.abs(last[:, None]) + 1e-300)
        here[:] = here[linear_sum_assignment(apart)[1]]
    return values.T


def _gain_margins(of: Matrices, loci: Complexes, omega: Floats, law: _Law) -> tuple[float, float, float, float]:
    """Gain margins below and above 1 with their frequencies, rad/s."""
    x = np.log(omega)

    def near(locus: Ints, w: Floats) -> tuple[Complexes, Floats]:
        """The locus at a frequency, and the harmonic that it belongs to most, rad/s."""
        w = np.maximum(w, _SLOWEST)
        j = np.clip(np.searchsorted(omega, w) - 1, 0, len(x) - 2)
        share = np.clip((np.log(w) - x[j]) / (x[j + 1] - x[j]), 0.0, 1.0)
        guess = loci[locus, j] * (1.0 - share) + loci[locus, j + 1] * share
        values, weights = _eigenvalues(_in_harmonics(law, of(w), w), law.ticks)
        rows, nearest = np.arange(locus.size), np.abs(values - guess[:, None]).argmin(axis=1)
        return values[rows, nearest], _harmonics(law, w)[rows, weights[rows, nearest].argmax(axis=1)]

    def at(locus: Ints, w: Floats) -> Closed:
        value = near(locus, w)[0] if locus.size else np.empty(0, complex)
        return Closed(value, value)

    def true(locus: int, w: Floats) -> float:
        """The frequency of a locus' own harmonic at its ``w`` [locus]."""
        here = w[[locus]]
        return abs(float(near(np.array([locus]), here)[1][0])) if np.isfinite(here[0]) else np.nan

    low, low_at, high, high_at = gain_margins(at, np.tile(omega, (len(loci), 1)), loci, law.period * law.ticks)
    below, above = int(low.argmax()), int(high.argmin())
    return float(low[below]), true(below, low_at), float(high[above]), true(above, high_at)


def _phase_and_delay(of: Matrices, values: Complexes, omega: Floats, law: _Law) -> tuple[float, float, float]:
    """Phase margin, rad, where it stands, rad/s, and delay margin, s, from eigenvalues [f, locus] at ``omega``.

    A locus of size 1 is found by its rank, which is continuous.
    """

    def sizes(values: Complexes) -> Floats:
        return log_size(np.sort(np.abs(values), axis=-1))

    def at(rank: Ints, w: Floats) -> Floats:
        return sizes(np.asarray(np.linalg.eigvals(of(w))))[np.arange(rank.size), rank]

    size = sizes(values).T
    rank, interval = changes_of_sign(size)
    if not rank.size:
        return np.inf, np.nan, np.inf
    grid = np.tile(omega, (len(size), 1))
    where = refine_crossings(at, size, grid, rank, interval)
    values, weights = _eigenvalues(_in_harmonics(law, of(where), where), law.ticks)
    rows, nearest = np.arange(where.size), np.abs(log_size(values)).argmin(axis=1)
    value, harmonic = values[rows, nearest], _harmonics(law, where)[rows, weights[rows, nearest].argmax(axis=1)]
    known = np.abs(log_size(value)) < 1e-6  # by more than rounding
    if not known.any():
        return np.inf, np.nan, np.inf
    where, value, harmonic = where[known], value[known], harmonic[known]
    turn = np.angle(value) + np.pi  # 0 .. 2 pi
    phase = np.minimum(turn, 2.0 * np.pi - turn)
    least = int(phase.argmin())
    late = np.where(harmonic > 0.0, turn, 2.0 * np.pi - turn) / np.abs(harmonic)
    delays = [_delayed(of, law, w, tau) for w, tau in zip(where, late, strict=True)]
    return float(phase[least]), abs(float(harmonic[least])), min(delays)


def _delayed(of: Matrices, law: _Law, omega: float, delay: float) -> float:
    """The delay near ``delay`` (s) at which a locus is -1 at a frequency near ``omega``, by Newton's method."""

    def left(x: Floats) -> Floats:
        w = np.array([np.exp(x[0])])
        late = np.exp(-1j * _harmonics(law, w)[0] * x[1])
        matrix = _in_harmonics(law, of(w), w)
        values = np.linalg.eigvals(matrix * np.tile(late, matrix.shape[1] // late.size))[0]
        apart = values[np.abs(values + 1.0).argmin()] + 1.0
        return np.array([apart.real, apart.imag])

    x = np.array([np.log(omega), delay])
    for _ in range(_NEWTON_STEPS):
        f = left(x)
        if np.abs(f).max() < 1e-11:
            break
        step = np.array([1e-7, 1e-7 * delay])
        J = np.column_stack([(left(x + d) - left(x - d)) / (2.0 * d.sum()) for d in np.diag(step)])
        x = x - np.linalg.lstsq(J, f, rcond=None)[0]
    return float(x[1]) if np.abs(left(x)).max() < 1e-6 and x[1] > 0.0 else delay


def _eigenvalues(matrices: Complexes, harmonics: int) -> tuple[Complexes, Floats]:
    """Eigenvalues [f, locus], zero where rounding hides them, and how much of each harmonic is in them.

    The weights [f, locus, harmonic] are nothing where no ``harmonics`` are asked for.
    """
    values, vectors = np.linalg.eig(matrices)
    duals = _solve(vectors, np.broadcast_to(np.eye(vectors.shape[-1]), vectors.shape))
    condition = np.linalg.norm(duals, axis=-1)
    size = np.linalg.norm(matrices, axis=(1, 2))[:, None]
    values = np.where(np.abs(values) > _ROUNDING * condition * size, values, 0.0)
    share = np.abs(duals * np.swapaxes(vectors, -1, -2))
    return values, share.reshape(*share.shape[:2], -1, max(harmonics, 1)).sum(axis=2)


def _largest_scaled(of: Matrices, M: Complexes, omega: Floats, inputs: int) -> tuple[float, float]:
    """Largest over frequency of the least norm of D M D^-1, D one scale for each input, and where it is."""
    bounds, scales = np.linalg.norm(M, axis=(1, 2)), np.zeros(inputs)
    tight = np.zeros(len(omega), bool)
    while not tight[best := int(bounds.argmax())]:
        bounds[best], scales = _least_norm(M[best], scales)
        tight[best] = True
        others = np.flatnonzero(~tight & (bounds > bounds[best]))
        bounds[others] = np.minimum(bounds[others], _norm(_scaled(M[others], scales)))
    peak, at = refine_peaks(
        lambda i, w: np.array([_least_norm(each, scales)[0] for each in of(w)]),
        omega[None],
        np.array([best]),
        bounds[[best]],
    )
    return float(peak[0]), float(at[0])


def _scaled(M: Complexes, log_scales: Floats) -> Complexes:
    d = np.exp(np.repeat(log_scales, M.shape[-1] // len(log_scales)))
    return np.asarray(d[:, None] * M / d)


def _least_norm(M: Complexes, start: Floats) -> tuple[float, Floats]:
    """The least norm of D M D^-1 and its logarithmic scales; convex, with the gradient of the singular vectors."""
    from scipy.optimize import minimize

    def norm(x: Floats) -> tuple[float, Floats]:
        u, size, v = np.linalg.svd(_scaled(M, x))
        slope = np.abs(u[:, 0]) ** 2 - np.abs(v[0]) ** 2
        return float(np.log(size[0])), slope.reshape(len(x), -1).sum(axis=1)

    found = minimize(norm, start, jac=True, method="BFGS")
    return float(np.exp(found.fun)), np.asarray(found.x)
