"""Margins of laws of several rates, from the responses of their loops lifted over the law's whole period.

A law that repeats after N ticks of T answers a frequency w with all of w + 2 pi m / (N T), m = 0 .. N - 1: a loop gain
is a matrix over these harmonics. A factor of an actuator in every tick is a number times the identity there, so that a
loop alone, the others closed, has N characteristic loci in place of one. Bittanti and Colaneri, Periodic Systems
(2009), chapters 2 and 6. A law that does the same in every tick has the margins of a single rate.
"""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc.stability.linearize import Linear
from abhv_mc.stability.margins import Closed, Margins, gain_margins, log_size
from abhv_mc.stability.search import changes_of_sign, refine_crossings, refine_peaks

_ROOM = 40_000  # elements of the matrices over harmonics that are made together
_SLOWEST = 1e-6  # rad/s, in place of zero, where integrators have no response
_ROUNDING = 1e-13  # of a matrix times a locus' condition: a smaller locus is taken for zero
_NEWTON_STEPS = 12


class _Law(NamedTuple):
    """Plant and law over a period."""

    phases: tuple[Linear, ...]
    system: int
    period: float  # s, of a tick
    closes: Floats  # [input] 0 where there is no loop


class _Loops(NamedTuple):
    """At frequencies [f]: all loops at once, and each alone with the others closed."""

    all: Complexes  # [f, 4 N, 4 N] loop gain, input by input
    S: Complexes  # [f, 4 N, 4 N] its sensitivity
    own: Complexes  # [f, 4, N, N] sensitivity of each loop
    alone: Complexes  # [f, 4, N, N] gain of each loop


Matrices = Callable[[Floats], Complexes]  # square ones at frequencies


def find_lifted_margins(linear: Linear, system: int, omega: Floats) -> Margins:
    """Margins of one system at frequencies ``omega`` [frequency] (rising to pi / (N T)) to look at first."""
    law = _make_law(linear, system)
    count, inputs = len(law.phases), len(law.closes)
    loops = _at(law, omega)
    grid, rows = np.tile(omega, (inputs, 1)), np.arange(inputs)

    def largest(centre: float) -> Floats:
        size = _norm(loops.own - centre * np.eye(count)).T
        found, _ = refine_peaks(
            lambda i, w: _norm(_at(law, w).own[rows, i] - centre * np.eye(count)), grid, size.argmax(1), size.max(1)
        )
        return found

    def loci(i: int) -> _Loci:
        return _Loci(lambda w: _at(law, w).alone[:, i], loops.alone[:, i], omega, law)

    alone = [loci(i) for i in range(inputs)]
    gains = np.array([each.gains() for each in alone])
    phases = np.array([each.phase_and_delay() for each in alone])
    half = 0.5 * np.eye(inputs * count)
    mu, mu_at = _largest_scaled(lambda w: _at(law, w).S - half, loops.S - half, omega, inputs)
    together = _Loci(lambda w: _at(law, w).all, loops.all, omega, law).phase_and_delay()[2]
    each = (*gains.T, *phases.T, largest(0.0), 1.0 / largest(0.5))
    return Margins._make(
        [*(np.asarray(value)[None] for value in each), *(np.array([v]) for v in (1 / mu, mu_at, together))]
    )


def fundamental_gains(linear: Linear, omega: Floats) -> Complexes:
    """Gains [frequency, loop] of the first system's loops at the frequency itself, its harmonics left out."""
    return _at(_make_law(linear, 0), omega).alone[:, :, 0, 0]


def _make_law(linear: Linear, system: int) -> _Law:
    return _Law(linear.phases, system, linear.period, np.where(linear.cut[system] == 0, 1.0, 0.0))


def _harmonics(law: _Law, omega: Floats) -> Floats:
    """Frequencies [f, harmonic] between - and + pi / T that answer ``omega`` [f]."""
    count = len(law.phases)
    m = (np.arange(count) + (count - 1) // 2) % count - (count - 1) // 2
    return np.asarray(omega[:, None] + 2.0 * np.pi / (count * law.period) * m)


def _at(law: _Law, omega: Floats) -> _Loops:
    """The loops at frequencies [f]."""
    count, inputs = len(law.phases), len(law.closes)
    some = max(_ROOM // (inputs * count) ** 2, 1)
    L = np.concatenate([_respond(law, omega[i : i + some]) for i in range(0, max(len(omega), 1), some)])
    S = _solve(np.eye(inputs * count) + L, np.broadcast_to(np.eye(inputs * count), L.shape))
    shape = (len(omega), inputs, count, inputs, count)
    T, diagonal = (S @ L).reshape(shape), np.arange(inputs)
    own, through = (np.moveaxis(each[:, diagonal, :, diagonal], 0, 1) for each in (S.reshape(shape), T))
    return _Loops(L, S, own, _solve(own, through))


def _respond(law: _Law, omega: Floats) -> Complexes:
    """Loop gain [f, 4 N, 4 N]: harmonics of minus the commands from harmonics of what goes into the actuators."""
    linear, p, count = law.phases[0], law.system, len(law.phases)
    z = np.exp(1j * law.period * _harmonics(law, omega))[..., None, None]  # [f, harmonic, 1, 1]
    n, inputs = linear.A.shape[1], len(law.closes)
    states = _solve(
        z * np.eye(n) - linear.A[p], np.broadcast_to(linear.B[p].astype(complex), (*z.shape[:2], n, inputs))
    )
    plant = linear.sense[p] @ states * z ** -float(linear.delay[p])  # [f, harmonic, measured, input]
    m = linear.law_A.shape[1]
    memory, begun = np.zeros((len(omega), m, inputs * count), complex), np.eye(m)
    commands, by_memory = [], []
    for tick, phase in enumerate(law.phases):
        measured = np.moveaxis(plant * z**tick, 1, 3).reshape(len(omega), -1, inputs * count)
        C, D = law.closes[:, None] * phase.law_C[p], law.closes[:, None] * phase.law_D[p]
        commands.append(C @ memory + D @ measured)
        by_memory.append(C @ begun)
        memory = phase.law_A[p] @ memory + phase.law_B[p] @ measured
        begun = phase.law_A[p] @ begun
    start = _solve(np.exp(1j * law.period * count * omega)[:, None, None] * np.eye(m) - begun, memory)
    u = np.stack([each + by @ start for each, by in zip(commands, by_memory, strict=True)], axis=1)
    back = z[:, :, 0, 0, None] ** -np.arange(count) / count  # [f, harmonic, tick]
    return np.asarray(-np.einsum("fmk,fkic->fimc", back, u).reshape(len(omega), inputs * count, -1))


def _solve(A: Complexes, b: Complexes) -> Complexes:
    """Solutions of systems [..., n, n]; where one of them is singular, of all of them slightly moved."""
    try:
        return np.asarray(np.linalg.solve(A, b))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.solve(A + 1e-14 * np.eye(A.shape[-1]), b))


def _norm(matrices: Complexes) -> Floats:
    return np.asarray(np.linalg.norm(matrices, 2, axis=(-2, -1)))


class _Loci:
    """Characteristic loci of loop gains over frequency, each followed from one frequency to the next."""

    def __init__(self, of: Matrices, matrices: Complexes, omega: Floats, law: _Law) -> None:
        from scipy.optimize import linear_sum_assignment

        self._of, self._omega, self._law = of, omega, law
        values = _eigenvalues(matrices, 0)[0]
        for last, here in pairwise(values):
            apart = np.abs(here - last[:, None]) / (np.abs(here) + np.abs(last[:, None]) + 1e-300)
            here[:] = here[linear_sum_assignment(apart)[1]]
        self._values = values.T  # [locus, frequency]
        self._grid = np.tile(omega, (len(self._values), 1))

    def _near(self, locus: Ints, omega: Floats) -> tuple[Complexes, Floats]:
        """The locus at a frequency, and the harmonic that it belongs to most, rad/s."""
        omega = np.maximum(omega, _SLOWEST)
        x = np.log(self._omega)
        j = np.clip(np.searchsorted(self._omega, omega) - 1, 0, len(x) - 2)
        share = np.clip((np.log(omega) - x[j]) / (x[j + 1] - x[j]), 0.0, 1.0)
        guess = self._values[locus, j] * (1.0 - share) + self._values[locus, j + 1] * share
        values, weights = _eigenvalues(self._of(omega), len(self._law.phases))
        rows, nearest = np.arange(locus.size), np.abs(values - guess[:, None]).argmin(axis=1)
        harmonic = weights[rows, nearest].argmax(axis=1)
        return values[rows, nearest], _harmonics(self._law, omega)[rows, harmonic]

    def gains(self) -> tuple[float, float, float, float]:
        """Gain margins below and above 1 with their frequencies, rad/s."""

        def at(locus: Ints, omega: Floats) -> Closed:
            value = self._near(locus, omega)[0] if locus.size else np.empty(0, complex)
            return Closed(value, value)

        span = self._law.period * len(self._law.phases)
        low, low_at, high, high_at = gain_margins(at, self._grid, self._values, span)
        below, above = int(low.argmax()), int(high.argmin())
        return float(low[below]), self._true(below, low_at), float(high[above]), self._true(above, high_at)

    def _true(self, locus: int, omega: Floats) -> float:
        """The frequency of a locus' own harmonic at its ``omega`` [locus]."""
        w = omega[[locus]]
        return abs(float(self._near(np.array([locus]), w)[1][0])) if np.isfinite(w[0]) else np.nan

    def phase_and_delay(self) -> tuple[float, float, float]:
        """Phase margin, rad, the frequency at which it stands, rad/s, and delay margin, s."""
        size = log_size(self._values)
        locus, interval = changes_of_sign(size)
        if not locus.size:
            return np.inf, np.nan, np.inf
        where = refine_crossings(lambda i, w: log_size(self._near(i, w)[0]), size, self._grid, locus, interval)
        value, harmonic = self._near(locus, where)
        turn = np.angle(value) + np.pi  # 0 .. 2 pi
        phase = np.minimum(turn, 2.0 * np.pi - turn)
        least = int(phase.argmin())
        late = np.where(harmonic > 0.0, turn, 2.0 * np.pi - turn) / np.abs(harmonic)
        delays = [self._delayed(w, tau) for w, tau in zip(where, late, strict=True)]
        return float(phase[least]), abs(float(harmonic[least])), min(delays)

    def _delayed(self, omega: float, delay: float) -> float:
        """The delay near ``delay`` (s) at which a locus is -1 at a frequency near ``omega``, by Newton's method."""

        def left(x: Floats) -> Floats:
            w = np.array([np.exp(x[0])])
            late = np.exp(-1j * _harmonics(self._law, w)[0] * x[1])
            matrix = self._of(w)
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
    values = np.where(np.abs(values) > _ROUNDING * condition * _norm(matrices)[:, None], values, 0.0)
    share = np.abs(duals * np.swapaxes(vectors, -1, -2))
    return values, share.reshape(*share.shape[:2], -1, max(harmonics, 1)).sum(axis=2)


def _largest_scaled(of: Matrices, M: Complexes, omega: Floats, inputs: int) -> tuple[float, float]:
    """Largest over frequency of the least norm of D M D^-1, D one scale for each input, and where it is."""
    bounds, scales = _norm(M), np.zeros(inputs)
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
