"""Linear models of the closed loop, and stability margins from their frequency responses.

A model contains plant, controller, sensors and delay at each point.

The loop gain L of a system is a matrix: all loops are cut at the plant's inputs, and the controller
commands -L v for an input v. For loop i alone, with the other loops closed, ``L_i = T_ii / S_ii``
with ``S = (1 + L)^-1`` and ``T = S L``. Disk margins: Seiler, Packard and Gahinet, IEEE Control
Systems 40 (2020) 78-95, with the symmetric disk (skew 0).

Responses are computed in Hessenberg form (Laub, IEEE Trans. Automatic Control 26 (1981) 407-408),
because in double precision the polynomial roots of models with 18 to 36 states are meaningless.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Complexes, Floats, Ints
from abhv_mc_vehicle.kernel.stability.loop_gains import fill_loop_gains
from abhv_mc_vehicle.kernel.stability.structured import (
    peak_of_structured_singular_values,
    structured_singular_values,
)
from abhv_mc_vehicle.stability.probe import INPUTS
from abhv_mc_vehicle.stability.search import (
    Quantity,
    refine_crossings,
    refine_peaks,
)

# reasons why an input has no loop
STUCK = 1
NO_EFFECT = 2
REASONS = {STUCK: "stuck", NO_EFFECT: "no effect"}


class Linear(NamedTuple):
    """Continuous and discrete linear models, one per point.

    Discrete models are x+ = A x + B u, y = C x + D u at the control rate.
    """

    period: float  # control period, s
    plant_A: (
        # [point, 10 + custom, 10 + custom] continuous plant; states: path coordinates, custom
        # states
        Floats
    )
    # [point, 10 + custom, actuator] effect of the positions of surfaces (or effectors) and engine
    plant_B: Floats
    # [point, n, n] discrete plant; states: path coordinates, actuators, custom states
    A: Floats
    B: Floats  # [point, n, input] effect of the commands
    # [point, memory, memory] dynamics of the controller's memory, with sensor states last
    law_A: Floats
    law_B: Floats  # [point, memory, 10] effect of the measurement on the memory
    law_C: Floats  # [point, input, memory] effect of the memory on the commands
    law_D: Floats  # [point, input, 10] effect of the measurement on the commands
    delay: Ints  # [point] delay of the measurement, control periods
    # [point, 10, n] measurement without delay; the row of a frozen measurement is zero
    sense: Floats
    cut: Ints  # [point, input] STUCK or NO_EFFECT if an input has no loop, else 0
    phases: "tuple[Linear, ...]" = ()  # one model per tick of a multi-rate controller's period
    inputs: tuple[str, ...] = INPUTS  # names of the plant inputs commanded by the controller
    # model with one input per effector, if the controller commands axes
    apart: "Linear | None" = None


class Loops(NamedTuple):
    """Plant and controller of each system, with A in Hessenberg form."""

    plant_A: Floats  # plant state matrix [system, n, n]
    plant_B: Floats  # plant input matrix [system, n, input]
    plant_C: Floats  # plant output matrix [system, output, n]
    law_A: Floats  # controller state matrix [system, m, m]
    law_B: Floats  # controller input matrix [system, m, output]
    law_C: Floats  # controller output matrix [system, input, m]
    law_D: Floats  # controller feedthrough matrix [system, input, output]
    delay: Ints  # delay of each system, control periods
    period: float  # control period, s


def make_loops(linear: Linear) -> Loops:
    """Return the plant and controller matrices of linear models, with A in Hessenberg form."""
    closes = (linear.cut == 0)[:, :, None]  # The command of a stuck surface belongs to no loop.
    plant = to_hessenberg(linear.A, linear.B, linear.sense)
    law = to_hessenberg(linear.law_A, linear.law_B, np.where(closes, linear.law_C, 0.0))
    law_D = np.where(closes, linear.law_D, 0.0)
    return Loops(*plant, *law, np.ascontiguousarray(law_D), linear.delay, linear.period)


def to_hessenberg(A: Floats, B: Floats, C: Floats) -> tuple[Floats, Floats, Floats]:
    """Transform the systems so that A is an upper Hessenberg matrix."""
    from scipy.linalg import hessenberg

    if A.shape[1] == 0:
        return A.copy(), B.copy(), C.copy()
    A = A.copy()
    B = B.copy()
    C = C.copy()
    for i in range(len(A)):
        A[i], Q = hessenberg(A[i], calc_q=True)
        B[i], C[i] = Q.T @ B[i], C[i] @ Q
    return A, B, C


def loop_gains(loops: Loops, system: Ints, omega: Floats) -> Complexes:
    """Return the loop gain L [point, input, input] of `system` [point] at `omega` (rad/s)."""
    points = len(omega)
    inputs = loops.law_D.shape[1]
    result = np.empty((points, inputs, inputs), np.complex128)
    fill_loop_gains(
        *loops[:8],
        np.asarray(system, np.int64),
        np.asarray(omega * loops.period, np.float64),
        result,
    )
    return result


# function of systems and frequencies (rad/s) that returns loop gains [point, input, input]
Response = Callable[[Ints, Floats], Complexes]

_FARTHEST = 1e6  # gain factor beyond which a gain margin counts as infinite (120 dB)
_APART = 1e-14  # multiple of the identity added to a possibly singular matrix


class Margins(NamedTuple):
    """Margins of each loop, with the others closed [system, loop], and of all loops [system].

    The margins are valid for stable systems; unlimited margins are infinite.
    """

    # largest gain factor below 1 that makes the loop neutrally stable; 0 if there is none
    gain_low: Floats
    gain_low_frequency: Floats  # frequency of the lower gain margin, rad/s
    gain_high: Floats
    gain_high_frequency: Floats
    phase: Floats  # phase margin, rad
    # gain crossover frequency at the phase margin, rad/s; NaN if there is no crossover
    crossover: Floats
    delay: Floats  # delay margin, s
    sensitivity: Floats  # largest |1 / (1 + L)| over frequency
    disk: Floats  # 1 / largest |S - 1/2|
    all_disk: Floats  # 1 / largest mu(S - I/2)
    all_disk_frequency: Floats
    all_delay: Floats  # delay margin for equal delays in all loops, s


class Closed(NamedTuple):
    """Responses of single loops, with the others closed."""

    L: Complexes  # loop gains [..., loop]
    S: Complexes  # sensitivities [..., loop]


# function of rows and frequencies (rad/s) that returns loci [point, locus]
Loci = Callable[[Ints, Floats], Complexes]
# function of rows, frequencies and loci of magnitude 1; returns frequencies and delay margins
Delays = Callable[[Ints, Floats, Complexes], tuple[Floats, Floats]]


def close(L: Complexes) -> tuple[Complexes, Closed]:
    """Return the sensitivity [..., input, input] and the single loops for loop gains L."""
    S = inverse(np.eye(L.shape[-1]) + L)
    alone = np.einsum("...ij,...ji->...i", S, L)
    own = np.einsum("...ii->...i", S)
    return S, Closed((alone / own), own)


def inverse(matrices: Complexes) -> Complexes:
    """Return the inverses of matrices [..., n, n], shifted slightly to avoid singularity.

    The matrix 1 + L is singular at a pole of the closed loop.
    """
    identity = np.eye(matrices.shape[-1])
    moved = matrices + _APART * identity
    try:
        return np.asarray(np.linalg.inv(moved))
    # A shift that is small relative to the elements may be lost to rounding.
    except np.linalg.LinAlgError:
        is_singular = np.linalg.slogdet(moved)[0] == 0.0
        size = np.where(is_singular, np.abs(matrices).max(axis=(-2, -1)), 0.0)
        return np.asarray(np.linalg.inv(moved + _APART * size[..., None, None] * identity))


def find_margins(response: Response, omega: Floats, period: float) -> Margins:
    """Return the margins of systems; `omega` [system, frequency] increases to pi / period."""
    systems, count = omega.shape
    L = response(np.repeat(np.arange(systems), count), omega.ravel())
    inputs = L.shape[-1]
    L = L.reshape(systems, count, inputs, inputs)
    S, closed = close(L)
    # The following arrays have one row for each loop of each system.
    grid = np.repeat(omega, inputs, axis=0)
    half = 0.5 * np.eye(inputs)
    gains, own = (np.moveaxis(responses, -1, 1).reshape(-1, count) for responses in closed)

    def at(loop: Ints, frequency: Floats) -> Closed:
        _, single_loops = close(response(loop // inputs, frequency))
        rows = np.arange(loop.size)
        return Closed(single_loops.L[rows, loop % inputs], single_loops.S[rows, loop % inputs])

    def alone(loop: Ints, frequency: Floats) -> Complexes:
        return at(loop, frequency).L[:, None]

    def farthest(centre: float) -> Floats:
        return largest(lambda i, w: np.abs(at(i, w).S - centre), grid, np.abs(own - centre))

    gain = gain_margins(alone, grid, gains[..., None], period)
    phase = phase_margins(alone, grid, gains[..., None])
    value, where = peak_of_structured_singular_values(S - half)
    mu, mu_at = refine_peaks(
        lambda i, w: structured_singular_values(close(response(i, w))[0] - half),
        omega,
        where,
        value,
    )
    delay = phase_margins(lambda i, w: eigenvalues(response(i, w)), omega, eigenvalues(L))[2]
    loop_margins = (*gain, *phase, farthest(0.0), 1.0 / farthest(0.5))
    return Margins._make(
        [*(values.reshape(systems, inputs) for values in loop_margins), 1.0 / mu, mu_at, delay]
    )


def eigenvalues(matrices: Complexes) -> Complexes:
    """Return the eigenvalues of matrices [..., n, n]."""
    return np.asarray(np.linalg.eigvals(matrices))


def largest(size: Quantity, grid: Floats, values: Floats) -> Floats:
    """Return the peak over frequency of the quantity `size` [row], given `values` on the grid."""
    return refine_peaks(size, grid, values.argmax(axis=1), values.max(axis=1))[0]


def _crossings(
    loci: Loci, quantity: Callable[[Complexes], Floats], grid: Floats, values: Complexes
) -> tuple[Ints, Floats, Complexes]:
    """Return rows, frequencies and loci of the zero crossings of a quantity.

    `values` has shape [row, frequency, locus]; at each frequency, loci are sorted by the quantity.
    """
    count = values.shape[-1]
    ranked = np.moveaxis(np.sort(quantity(values), axis=-1), -1, 1).reshape(-1, grid.shape[1])
    branch, interval = np.nonzero(np.diff(ranked > 0.0, axis=1))

    def at(branch: Ints, frequency: Floats) -> Complexes:
        candidates = loci(branch // count, frequency)
        order = np.argsort(quantity(candidates), axis=-1)
        return np.take_along_axis(candidates, order, axis=-1)[
            np.arange(branch.size), branch % count
        ]

    grids = np.repeat(grid, count, axis=0)
    where = refine_crossings(lambda i, w: quantity(at(i, w)), ranked, grids, branch, interval)
    return branch // count, where, at(branch, where)


def gain_margins(
    loci: Loci, grid: Floats, values: Complexes, period: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the destabilizing gains [row] nearest to 1 from either side, with frequencies."""

    def turned(gains: Complexes) -> Floats:  # Zero gains are not valid loci and are sorted last.
        return np.where(gains == 0.0, 2.0, np.sin(np.angle(gains)))

    row, where, value = _crossings(loci, turned, grid, values)
    # At zero frequency and at half the sampling rate, every loop gain is real.
    rows = np.arange(len(grid))
    end_rows = np.repeat(rows, values.shape[-1])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ends = [loci(rows, np.full(rows.size, w)).ravel() for w in (0.0, np.pi / period)]
    row = np.concatenate([row, end_rows, end_rows])
    where = np.concatenate([where, 0.0 * end_rows, np.pi / period + 0.0 * end_rows])
    value = np.concatenate([value, *ends])
    with np.errstate(divide="ignore", invalid="ignore"):
        k = -1.0 / value.real
        crosses = np.isfinite(k) & (k > 1.0 / _FARTHEST) & (k < _FARTHEST)
        crosses &= np.abs(value.imag) < 1e-3 * np.abs(
            value.real
        )  # Exclude sign changes at which the locus jumps through infinity.
    low = np.zeros(rows.size)
    high = np.full(rows.size, np.inf)
    low_at, high_at = np.full((2, rows.size), np.nan)
    order = np.argsort(
        -np.abs(np.log(np.where(crosses, k, _FARTHEST)))
    )  # The last entry, which overwrites the previous entries, is the nearest to 1.
    for i in order[crosses[order]]:
        if k[i] < 1.0:
            low[row[i]], low_at[row[i]] = k[i], where[i]
        else:
            high[row[i]], high_at[row[i]] = k[i], where[i]
    return low, low_at, high, high_at


def _delays_at_once(_: Ints, frequency: Floats, locus: Complexes) -> tuple[Floats, Floats]:
    return frequency, (np.angle(locus) + np.pi) / frequency


def phase_margins(
    loci: Loci, grid: Floats, values: Complexes, delays: Delays = _delays_at_once
) -> tuple[Floats, Floats, Floats]:
    """Return the phase margin (rad), its frequency (rad/s) and the delay margin (s) [row].

    The margins are evaluated at the frequencies at which a locus has magnitude 1.
    """
    row, where, value = _crossings(loci, _log_size, grid, values)
    turn = np.angle(value) + np.pi  # angle between -1 and the locus, from 0 to 2 pi
    where, late = delays(row, where, value)
    phase, delay = np.full((2, len(grid)), np.inf)
    crossover = np.full(len(grid), np.nan)
    for i, w, distance, tau in zip(
        row, where, np.minimum(turn, 2.0 * np.pi - turn), late, strict=True
    ):
        if distance < phase[i]:
            phase[i] = distance
            crossover[i] = w
        delay[i] = min(delay[i], tau)
    return phase, crossover, delay


def _log_size(gains: Complexes) -> Floats:
    """Return the logarithm of the magnitude of gains, which are zero for cut loops."""
    return np.log(np.maximum(np.abs(gains), 1e-300))


def disk_gain_and_phase(alpha: Floats) -> tuple[Floats, Floats]:
    """Return the gain factor and phase (rad) that a disk margin allows."""
    with np.errstate(divide="ignore"):
        gain = np.where(
            alpha >= 2.0, np.inf, (1.0 + 0.5 * alpha) / np.maximum(1.0 - 0.5 * alpha, 1e-300)
        )
    return gain, 2.0 * np.arctan(0.5 * alpha)
