"""Attitude rates of the design model against vectors, and LQR gains against python-control."""

from pathlib import Path

import control
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.design.design_model import attitude_rates
from abhv_mc_vehicle.control.design.lqr_design import (
    gains_at,
    make_lqr_gains,
    make_lqr_models,
    make_models,
    make_nominal,
    regulator,
)
from abhv_mc_vehicle.kernel.laws.columns import LQR_ELEVATOR, LQR_GAINS, LQR_GUIDANCE, LQR_LATERAL

CONFIGS = Path(__file__).parents[4] / "configs"


@pytest.fixture(scope="module")
def controller():
    return read_controller(CONFIGS / "control" / "lqr.yaml")


@pytest.fixture(scope="module")
def gains(controller, mission, reference, vehicle, trim_tables):
    return make_lqr_gains(controller, mission, reference, vehicle, trim_tables)


@pytest.fixture(scope="module")
def nominal_at(mission, reference):
    return lambda knot: make_nominal(mission, reference[knot])


def weights(controller):
    regulators = (controller.guidance, controller.longitudinal, controller.lateral)
    return [
        tuple(np.diag([v for _, v in diagonal]) for diagonal in (p.states, p.inputs))
        for p in regulators
    ]


def split(row):
    """Return the three gain matrices, with deflections in degrees."""
    degrees = 180.0 / np.pi
    return [
        row[LQR_GUIDANCE:LQR_ELEVATOR].reshape(3, 4),
        degrees * row[LQR_ELEVATOR:LQR_LATERAL].reshape(1, 2),
        degrees * row[LQR_LATERAL:].reshape(2, 4),
    ]


@pytest.mark.parametrize("knot", [0, 700, 2500, 4999, 5000, 6000])
def test_gains_satisfy_their_riccati_equations(
    knot, controller, nominal_at, vehicle, trim_tables, gains
):
    models = make_models(vehicle, trim_tables, nominal_at(knot))
    units = (1.0, np.pi / 180.0, np.pi / 180.0)  # the paper's weights are of degrees
    for (A, B), unit, (Q, R), K in zip(
        models, units, weights(controller), split(gains[knot]), strict=True
    ):
        poles = np.linalg.eigvals(A - unit * B @ K)
        assert poles.real.max() < 0.0
        theirs, _, _ = control.lqr(A, unit * B, Q, R, method="scipy")
        np.testing.assert_allclose(theirs, K, rtol=1e-8, atol=1e-10 * np.abs(K).max())


def test_stacked_regulators_solve_equations_that_eigenvectors_do_not():
    """A chain of integrators with equal closed-loop poles (1, 2, 1) has dependent eigenvectors."""
    chain, push = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    A, B = np.array([chain, chain - np.eye(2), 3.0 * chain]), np.array([push, push, 2.0 * push])
    Q, R = np.diag([1.0, 2.0]), np.eye(1)
    gains = regulator(A, B, Q, R)
    np.testing.assert_allclose(gains[0], [[1.0, 2.0]], rtol=1e-7)
    for K, a, b in zip(gains, A, B, strict=True):
        np.testing.assert_allclose(K, control.lqr(a, b, Q, R, method="scipy")[0], rtol=1e-7)
    with pytest.raises(np.linalg.LinAlgError):
        regulator(np.array([np.eye(2)]), np.zeros((1, 2, 1)), Q, R)


def test_gains_are_not_interpolated_across_a_step(
    controller, nominal_at, reference, vehicle, trim_tables, gains
):
    """At 50 s the bank steps by 46 deg, and with it the gain from path error to bank."""
    assert gains.shape == (len(reference), len(LQR_GAINS))
    for knot in (0, 4999, 5000, 6000):
        exact = gains_at(controller, make_models(vehicle, trim_tables, nominal_at(knot)))
        np.testing.assert_allclose(gains[knot], exact, rtol=1e-12)
    between = gains_at(controller, make_models(vehicle, trim_tables, nominal_at(2350)))
    np.testing.assert_allclose(gains[2350], between, rtol=0.02, atol=0.02 * np.abs(between).max())
    jump = np.abs(gains[5000] - gains[4999])
    usual = np.abs(np.diff(gains[:5000], axis=0)).max(axis=0)
    moved = LQR_GAINS.index("bank_by_path")
    assert jump[moved] > 100.0 * usual[moved]


def test_ramps_have_knots_each_tenth_of_a_second(mission, vehicle, trim_tables, reference):
    ramped = mission.model_copy(
        update={"manoeuvre": mission.manoeuvre.model_copy(update={"bank_time": 2.0})}
    )
    knots = np.concatenate(
        [piece.knots for piece in make_lqr_models(5.0, ramped, reference, vehicle, trim_tables)]
    )
    for first in (0, 4800):
        assert set(range(first, first + 200, 10)) <= set(knots)
    assert len(knots) < 70  # each 5 s elsewhere


def wind_from_ned(chi, gamma, bank):
    return Rotation.from_euler("ZYX", [chi, gamma, bank]).inv().as_matrix()


def body_from_wind(alpha, beta):
    return Rotation.from_euler("ZY", [-beta, alpha]).inv().as_matrix()


def angles_of(v, body_from_ned):
    """Return alpha, beta and bank of a velocity (NED) and an attitude."""
    u = body_from_ned @ v
    alpha, beta = np.arctan2(u[2], u[0]), np.arcsin(u[1] / np.linalg.norm(u))
    down = body_from_wind(alpha, beta).T @ body_from_ned @ np.array([0.0, 0.0, 1.0])
    return np.array([alpha, beta, np.arctan2(down[1], down[2])])


@pytest.mark.parametrize("seed", range(20))
def test_rates_of_aerodynamic_angles_agree_with_vectors(seed):
    generator = np.random.default_rng(seed)
    alpha, beta, bank = generator.uniform([-0.1, -0.2, -1.3], [0.3, 0.2, 1.3])
    gamma, chi = generator.uniform([-0.6, -3.0], [0.6, 3.0])
    rates = generator.uniform(-0.5, 0.5, 3)
    force = generator.uniform(-3e4, 3e4, 3)
    mass, speed, gravity = 1372.0, 1400.0, 9.8
    attitude = body_from_wind(alpha, beta) @ wind_from_ned(chi, gamma, bank)
    v = speed * wind_from_ned(chi, gamma, bank).T @ np.array([1.0, 0.0, 0.0])
    np.testing.assert_allclose(angles_of(v, attitude), [alpha, beta, bank], atol=1e-14)

    acceleration = attitude.T @ force / mass + [0.0, 0.0, gravity]
    p, q, r = rates
    spin = np.array([[0.0, -r, q], [r, 0.0, -p], [-q, p, 0.0]])
    h = 1e-5
    ends = [angles_of(v + s * acceleration, attitude - s * spin @ attitude) for s in (-h, h)]
    expected = (ends[1] - ends[0]) / (2.0 * h)
    rates_of_angles = attitude_rates(force, mass, speed, gravity, gamma, (alpha, beta, bank), rates)
    np.testing.assert_allclose(rates_of_angles, expected, atol=1e-8)
