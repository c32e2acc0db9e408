"""Stability margins of sampled loops from their frequency responses.

A system's loop gain L is a matrix: all loops are cut at the plant's inputs, the law commands -L v when v goes in. Loop
i alone, the others closed, is ``L_i = T_ii / S_ii`` with ``S = (1 + L)^-1`` and ``T = S L``. Disk margins: Seiler,
Packard and Gahinet, IEEE Control Systems 40 (2020) 78-95, with the symmetric disk (skew 0).
"""

import contextlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc.kernel.stability.structured import peak_of_structured_singular_values, structured_singular_values
from abhv_mc.stability.search import changes_of_sign, refine_crossings, refine_peaks

# Loop gains [point, input, input] of systems [point] at frequencies [point], rad/s.
Response = Callable[[Ints, Floats], Complexes]

_FARTHEST = 1e6  # a gain margin beyond 120 dB is none


class Margins(NamedTuple):
    """Margins of each loop with the others closed, [system, loop], and of all at once, [system].

    Infinite where there is none. Only of systems whose closed loop is stable do they mean anything.
    """

    gain_low: Floats  # the gain below 1 nearest to it that makes the loop neutral, 0 where none does
    gain_low_frequency: Floats  # rad/s
    gain_high: Floats
    gain_high_frequency: Floats
    phase: Floats  # rad
    crossover: Floats  # rad/s, where the gain is 1 and the phase margin stands; nan where the gain is nowhere 1
    delay: Floats  # s
    sensitivity: Floats  # largest |1 / (1 + L)|
    disk: Floats  # 1 / largest |S - 1/2|
    all_disk: Floats  # 1 / largest mu(S - I/2)
    all_disk_frequency: Floats
    all_delay: Floats  # s, the same in all loops


class Closed(NamedTuple):
    """Responses of single loops, the others closed."""

    L: Complexes  # [..., loop]
    S: Complexes  # [..., loop]


# One loop alone of the rows [point], which count the loops of system after system, at frequencies [point].
Single = Callable[[Ints, Floats], Closed]


def close(L: Complexes) -> tuple[Complexes, Closed]:
    """Sensitivity [..., input, input] and the single loops of loop gains [..., input, input]."""
    eye = np.eye(L.shape[-1])
    S = _inverses(eye + L)
    alone = np.einsum("...ij,...ji->...i", S, L)
    own = np.einsum("...ii->...i", S)
    return np.asarray(S), Closed(np.asarray(alone / own), own)


def _inverses(matrices: Complexes) -> Complexes:
    """Inverses of matrices [..., n, n]; nan of what is singular: a pole of the closed loop, such as an integrator."""
    try:
        return np.asarray(np.linalg.inv(matrices))
    except np.linalg.LinAlgError:
        found = np.full_like(matrices, np.nan)
        for place in np.ndindex(matrices.shape[:-2]):
            with contextlib.suppress(np.linalg.LinAlgError):
                found[place] = np.linalg.inv(matrices[place])
        return found


def find_margins(response: Response, omega: Floats, period: float) -> Margins:
    """Margins of systems with frequencies ``omega`` [system, frequency] (rising to pi / period) to look at first."""
    systems, count = omega.shape
    L = response(np.repeat(np.arange(systems), count), omega.ravel())
    inputs = L.shape[-1]
    L = L.reshape(systems, count, inputs, inputs)
    S, closed = close(L)
    # From here on a row for each loop of each system.
    grid = np.repeat(omega, inputs, axis=0)
    gains = np.moveaxis(closed.L, -1, 1).reshape(-1, count)
    own = np.moveaxis(closed.S, -1, 1).reshape(-1, count)

    def at(loop: Ints, frequency: Floats) -> Closed:
        _, found = close(response(loop // inputs, frequency))
        rows = np.arange(loop.size)
        return Closed(found.L[rows, loop % inputs], found.S[rows, loop % inputs])

    low, low_at, high, high_at = gain_margins(at, grid, gains, period)
    phase, crossover, delay = _phase_margins(at, grid, gains)
    sensitivity, disk = (_largest(at, grid, own, centre) for centre in (0.0, 0.5))
    mu, mu_at = _largest_mu(response, omega, S)
    each = (low, low_at, high, high_at, phase, crossover, delay, sensitivity, 1.0 / disk)
    together = (1.0 / mu, mu_at, _common_delay(response, omega, L))
    return Margins._make([*(value.reshape(systems, inputs) for value in each), *together])


def _largest(at: Single, grid: Floats, own: Complexes, centre: float) -> Floats:
    """Largest distance [row] of the sensitivity from ``centre`` over frequency."""
    size = np.abs(own - centre)
    found, _ = refine_peaks(lambda i, w: np.abs(at(i, w).S - centre), grid, size.argmax(axis=1), size.max(axis=1))
    return found


def gain_margins(at: Single, grid: Floats, gains: Complexes, period: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Gains [row] below and above 1 that are nearest to it and make a loop neutral, each with its frequency."""
    turned = np.sin(np.angle(gains))
    loop, interval = changes_of_sign(turned)
    where = refine_crossings(lambda i, w: np.sin(np.angle(at(i, w).L)), turned, grid, loop, interval)
    value = at(loop, where).L
    # At zero frequency and at half the sampling rate every loop is real.
    rows = np.arange(len(grid))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ends = [at(rows, np.full(rows.size, w)).L for w in (0.0, np.pi / period)]
    loop = np.concatenate([loop, rows, rows])
    where = np.concatenate([where, 0.0 * rows, np.pi / period + 0.0 * rows])
    value = np.concatenate([value, *ends])
    with np.errstate(divide="ignore", invalid="ignore"):
        k = -1.0 / value.real
        crosses = np.isfinite(k) & (k > 1.0 / _FARTHEST) & (k < _FARTHEST)
        crosses &= np.abs(value.imag) < 1e-3 * np.abs(value.real)  # and does not jump through infinity
    low, high = np.zeros(rows.size), np.full(rows.size, np.inf)
    low_at, high_at = np.full(rows.size, np.nan), np.full(rows.size, np.nan)
    order = np.argsort(-np.abs(np.log(np.where(crosses, k, _FARTHEST))))  # the nearest last, which then stands
    for i in order[crosses[order]]:
        if k[i] < 1.0:
            low[loop[i]], low_at[loop[i]] = k[i], where[i]
        else:
            high[loop[i]], high_at[loop[i]] = k[i], where[i]
    return low, low_at, high, high_at


def _phase_margins(at: Single, grid: Floats, gains: Complexes) -> tuple[Floats, Floats, Floats]:
    size = log_size(gains)
    loop, interval = changes_of_sign(size)
    where = refine_crossings(lambda i, w: log_size(at(i, w).L), size, grid, loop, interval)
    angle = np.angle(at(loop, where).L) + np.pi  # 0 .. 2 pi
    phase, delay = np.full(len(grid), np.inf), np.full(len(grid), np.inf)
    crossover = np.full(len(grid), np.nan)
    for i, w, turn in zip(loop, where, angle, strict=True):
        distance = min(turn, 2.0 * np.pi - turn)
        if distance < phase[i]:
            phase[i], crossover[i] = distance, w
        delay[i] = min(delay[i], turn / w)
    return phase, crossover, delay


def log_size(gains: Complexes) -> Floats:
    """Where there is no loop, its gain is zero."""
    return np.asarray(np.log(np.maximum(np.abs(gains), 1e-300)))


def _largest_mu(response: Response, omega: Floats, S: Complexes) -> tuple[Floats, Floats]:
    half = 0.5 * np.eye(S.shape[-1])
    value, at = peak_of_structured_singular_values(S - half)
    return refine_peaks(lambda i, w: structured_singular_values(close(response(i, w))[0] - half), omega, at, value)


def _common_delay(response: Response, omega: Floats, L: Complexes) -> Floats:
    """Least delay of all loops at once, s: where an eigenvalue of L has size 1, by its rank, which is continuous."""
    systems, count, inputs = L.shape[:3]
    sizes = np.sort(np.abs(np.linalg.eigvals(L)), axis=-1)
    rows = np.log(np.maximum(np.moveaxis(sizes, -1, 1).reshape(-1, count), 1e-300))
    grid = np.repeat(omega, inputs, axis=0)

    def eigenvalue(row: Ints, frequency: Floats) -> Complexes:
        values = np.linalg.eigvals(response(row // inputs, frequency))
        order = np.argsort(np.abs(values), axis=-1)
        chosen = np.take_along_axis(values, order, axis=-1)
        return np.asarray(chosen[np.arange(row.size), row % inputs])

    row, interval = changes_of_sign(rows)
    where = refine_crossings(lambda i, w: np.log(np.abs(eigenvalue(i, w))), rows, grid, row, interval)
    turn = np.angle(eigenvalue(row, where)) + np.pi
    delay = np.full(systems, np.inf)
    np.minimum.at(delay, row // inputs, turn / where)
    return delay


def disk_gain_and_phase(alpha: Floats) -> tuple[Floats, Floats]:
    """Gain factor and phase (rad) that a disk margin allows in either direction; inf where it allows any gain."""
    with np.errstate(divide="ignore"):
        gain = np.where(alpha >= 2.0, np.inf, (1.0 + 0.5 * alpha) / np.maximum(1.0 - 0.5 * alpha, 1e-300))
    return gain, 2.0 * np.arctan(0.5 * alpha)
