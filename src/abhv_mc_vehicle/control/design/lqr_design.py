"""Gains of the LQR along the reference (Zhu and Shen 2014, section 7, eqs. 22-23).

The guidance model is linearized with the trim tables and the attitude model with the full tables,
both by complex steps.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats, Numbers
from abhv_mc.process_settings import one_blas_thread
from abhv_mc_vehicle.control.controller_file import LqrController, Weights
from abhv_mc_vehicle.control.design.design_cache import cache_results
from abhv_mc_vehicle.control.design.design_model import (
    Environment,
    attitude_rates,
    body_rate_rates,
    guidance_rates,
    make_environment,
    slope,
    wrench_at,
)
from abhv_mc_vehicle.control.design.profile import ramp_times
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.kernel.laws.columns import LQR_GAINS, REFERENCE
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle

_DEGREE = np.pi / 180.0
_RESIDUAL = 1e-10  # largest residual of a Riccati equation relative to its largest term
_RAMP_SPACING = 0.1  # time between gain knots during bank ramps, s


class Nominal(NamedTuple):
    """Nominal operating point, or stacked points, on the reference, in SI units and radians."""

    environment: Environment
    mass: float
    speed: float
    flight_path_angle: float
    heading: float
    angle_of_attack: float
    bank: float
    equivalence_ratio: float
    elevator: float

    def turn_rates(self) -> tuple[float, float, float]:
        """Return the body rates p, q and r of the coordinated turn.

        In stability axes ``q = (g/V) sin s tan s`` and ``r = (g/V) sin s``.
        """
        turn = self.environment.gravity / self.speed * np.sin(self.bank)
        alpha = self.angle_of_attack
        return -turn * np.sin(alpha), turn * np.tan(self.bank), turn * np.cos(alpha)


class LinearModels(NamedTuple):
    """Matrices A and B [..., row, column] of each regulator, in SI units and radians."""

    guidance: tuple[Floats, Floats]
    longitudinal: tuple[Floats, Floats]  # input: elevator
    lateral: tuple[Floats, Floats]  # inputs: aileron and rudder


class Piece(NamedTuple):
    """Linear models along a segment of the reference that contains no steps."""

    first: int  # first tick of the segment
    end: int  # tick after the last tick of the segment
    knots: NDArray[np.int64]  # ticks of the knots
    models: LinearModels  # linear models [knot, row, column]


def make_lqr_gains(
    controller: LqrController,
    mission: Mission,
    reference: Floats,
    vehicle: Vehicle,
    trim_tables: Tables,
) -> Floats:
    """Return gains ``[tick, gain]`` in the order of LQR_GAINS, in SI units and radians.

    The control law is ``u = nominal - K (x - nominal)``. Gains are interpolated in time between
    knots, never across a step. Raise LinAlgError if there is no stabilizing gain.
    """
    pieces = make_lqr_models(controller.spacing, mission, reference, vehicle, trim_tables)
    return gains_of_models(controller, pieces, reference[:, REFERENCE.index("time")])


@cache_results
def make_lqr_models(
    spacing: float, mission: Mission, reference: Floats, vehicle: Vehicle, trim_tables: Tables
) -> list[Piece]:
    """Return the linear models along the reference, one piece per segment.

    Segments are the bank ramps, and the intervals between ramps or steps.
    """
    tick = reference[1, 0] - reference[0, 0]
    ramps = [
        tuple(int(np.ceil(time / tick - 1e-6)) for time in ramp) for ramp in ramp_times(mission)
    ]
    starts = sorted(
        start
        for start in {0, *(start for ramp in ramps for start in ramp)}
        if start < len(reference)
    )
    pieces = []
    for first, end in zip(starts, [*starts[1:], len(reference)], strict=True):
        in_ramp = any(begin <= first < last for begin, last in ramps)
        stride = max(1, round(min(spacing, _RAMP_SPACING) / tick if in_ramp else spacing / tick))
        knots = np.unique([*range(first, end, stride), end - 1])
        nominals = [make_nominal(mission, reference[knot]) for knot in knots]
        environment = np.array([nominal.environment for nominal in nominals])
        values = np.array([nominal[1:] for nominal in nominals])
        stacked = Nominal(Environment(*environment.T), *values.T)
        pieces.append(Piece(first, end, knots, make_models(vehicle, trim_tables, stacked)))
    return pieces


@one_blas_thread()
def gains_of_models(controller: LqrController, pieces: list[Piece], times: Floats) -> Floats:
    """Return gains ``[tick, gain]`` from linear models; see :func:`make_lqr_gains`."""
    gains = np.empty((times.size, len(LQR_GAINS)))
    for first, end, knots, models in pieces:
        at_knots = gains_at(controller, models)
        for gain in range(len(LQR_GAINS)):
            gains[first:end, gain] = np.interp(times[first:end], times[knots], at_knots[:, gain])
    return gains


def make_nominal(mission: Mission, row: Floats) -> Nominal:
    """Return the nominal operating point of one row of the reference."""
    value = dict(zip(REFERENCE, row.tolist(), strict=True))
    fixed_earth = mission.make_earth()._replace(rotation_rate=0.0)
    return Nominal(
        make_environment(fixed_earth, value["altitude"], value["latitude"], mission.make_air()),
        *(value[name] for name in Nominal._fields[1:]),
    )


def make_models(vehicle: Vehicle, trim_tables: Tables, nominal: Nominal) -> LinearModels:
    """Return the three linear models at one point, or at the points of stacked numbers.

    The states are (altitude, gamma, chi, V), (alpha, q) and (bank, beta, p, r).
    """
    environment, mass, speed, gamma, chi, alpha, bank, eta, _ = nominal
    operating_point = [environment.altitude, gamma, chi, speed, alpha, bank, eta]
    guide = slope(
        lambda x: guidance_rates(vehicle, trim_tables, environment, mass, x[:4], x[4:]),
        operating_point,
    )
    turn = attitude_slopes(vehicle, nominal)
    pitch = turn[..., [0, 4], :]
    roll_yaw = turn[..., [2, 1, 3, 5], :]
    pairs = (
        (guide[..., :4], guide[..., 4:]),
        (pitch[..., [0, 4]], pitch[..., [8]]),
        (roll_yaw[..., [2, 1, 3, 5]], roll_yaw[..., [6, 7]]),
    )
    # The layout of the matrices determines the last digits of the gains.
    return LinearModels(*((np.array(A, order="C"), np.array(B, order="C")) for A, B in pairs))


def gains_at(controller: LqrController, models: LinearModels) -> Floats:
    """Return the gains [..., gain] for one model or stacked models, in the order of LQR_GAINS."""
    gains = (
        _gain(controller.guidance, models.guidance, 1.0),
        _gain(controller.longitudinal, models.longitudinal, _DEGREE),
        _gain(controller.lateral, models.lateral, _DEGREE),
    )
    return np.concatenate([gain.reshape(*gain.shape[:-2], -1) for gain in gains], axis=-1)


def _gain(weights: Weights[Any, Any], model: tuple[Floats, Floats], unit: float) -> Floats:
    """Return a regulator's gains in SI units; the weights apply to inputs in ``unit``."""
    A, B = model
    Q, R = (
        np.diag(np.array([weight for _, weight in pairs], np.float64))
        for pairs in (weights.states, weights.inputs)
    )
    return unit * regulator(A, B * unit, Q, R)


def regulator(A: Floats, B: Floats, Q: Floats, R: Floats) -> Floats:
    """Return the gains K of ``u = -K x`` that minimise the integral of ``x'Qx + u'Ru``.

    ``A`` [..., state, state] and ``B`` [..., state, input] may be stacked. The Riccati equations
    are solved together from the stable eigenvectors of their Hamiltonian matrices. If an equation
    has too few or nearly dependent eigenvectors, it is solved by the Schur method, which raises
    numpy.linalg.LinAlgError if there is no stabilizing gain.
    """
    n = A.shape[-1]
    B_transposed = B.swapaxes(-1, -2)
    G = B @ np.linalg.solve(R, B_transposed)
    hamiltonian = np.block([[A, -G], [np.broadcast_to(-Q, A.shape), -A.swapaxes(-1, -2)]])
    poles, vectors = np.linalg.eig(hamiltonian)
    order = np.argsort(poles.real, axis=-1)[..., :n]
    stable = np.take_along_axis(vectors, order[..., None, :], axis=-1).swapaxes(-1, -2)
    try:
        X = np.linalg.solve(stable[..., :n], stable[..., n:]).real
    except np.linalg.LinAlgError:
        X = np.full(A.shape, np.nan)
    slopes = A.swapaxes(-1, -2) @ X
    residual = slopes + X @ A - X @ G @ X + Q
    scale = np.abs(slopes).max(axis=(-1, -2)) + np.abs(Q).max()
    is_solved = np.abs(residual).max(axis=(-1, -2)) <= _RESIDUAL * scale
    is_solved &= np.count_nonzero(poles.real < 0.0, axis=-1) == n
    for index in np.argwhere(~is_solved):
        from scipy.linalg import solve_continuous_are

        X[(*index,)] = solve_continuous_are(A[(*index,)], B[(*index,)], Q, R)
    return np.asarray(np.linalg.solve(R, B_transposed @ X))


def attitude_slopes(vehicle: Vehicle, nominal: Nominal) -> Floats:
    """Return the Jacobian [..., 6, 9] of :func:`attitude_model_rates` in the coordinated turn."""
    operating_point = [
        nominal.angle_of_attack,
        0.0,
        nominal.bank,
        *nominal.turn_rates(),
        0.0,
        0.0,
        nominal.elevator,
    ]
    return slope(lambda x: attitude_model_rates(vehicle, nominal, x), operating_point)


def attitude_model_rates(vehicle: Vehicle, nominal: Nominal, x: Numbers) -> Numbers:
    """Return the rates of (alpha, beta, bank, p, q, r) from the full tables.

    ``x`` contains these states, followed by (aileron, rudder, elevator).
    """
    environment, mass, speed, gamma = nominal[:4]
    wrench = wrench_at(
        vehicle, environment, mass, speed, x[0], x[1], x[3:6], x[6:9], nominal.equivalence_ratio
    )
    angles = attitude_rates(wrench.force, mass, speed, environment.gravity, gamma, x[:3], x[3:6])
    return np.concatenate([angles, body_rate_rates(wrench.inertia, wrench.moment, x[3:6])])
