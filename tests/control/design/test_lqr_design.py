"""LQR: Riccati equations, stable loops, python-control's gains, and no interpolation across a step."""

from pathlib import Path

import control
import numpy as np
import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.design.lqr_design import (
    attitude_slopes,
    gains_at,
    guidance_model,
    lateral_model,
    longitudinal_model,
    make_lqr_gains,
    make_lqr_models,
    make_models,
    make_nominal,
)
from abhv_mc.kernel.laws.columns import LQR_ELEVATOR, LQR_GAINS, LQR_GUIDANCE, LQR_LATERAL
from abhv_mc.vehicle.evaluate import evaluate_coefficients, evaluate_fixed, make_variables

CONFIGS = Path(__file__).parents[3] / "configs"


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
    parts = (controller.guidance, controller.longitudinal, controller.lateral)
    return [tuple(np.diag([v for _, v in part]) for part in (p.states, p.inputs)) for p in parts]


def split(row):
    """The three gain matrices, deflections in degrees."""
    degrees = 180.0 / np.pi
    return [
        row[LQR_GUIDANCE:LQR_ELEVATOR].reshape(3, 4),
        degrees * row[LQR_ELEVATOR:LQR_LATERAL].reshape(1, 2),
        degrees * row[LQR_LATERAL:].reshape(2, 4),
    ]


@pytest.mark.parametrize("knot", [0, 700, 2500, 4999, 5000, 6000])
def test_gains_satisfy_their_riccati_equations(knot, controller, nominal_at, vehicle, trim_tables, gains):
    slopes = attitude_slopes(vehicle, nominal_at(knot))
    # The paper's weights are of degrees.
    attitude = [(A, B * np.pi / 180.0) for A, B in (longitudinal_model(slopes), lateral_model(slopes))]
    systems = [guidance_model(vehicle, trim_tables, nominal_at(knot)), *attitude]
    for (A, B), (Q, R), K in zip(systems, weights(controller), split(gains[knot]), strict=True):
        poles = np.linalg.eigvals(A - B @ K)
        assert poles.real.max() < 0.0
        theirs, _, _ = control.lqr(A, B, Q, R, method="scipy")
        np.testing.assert_allclose(theirs, K, rtol=1e-8, atol=1e-10 * np.abs(K).max())


def test_gains_are_not_interpolated_across_a_step(controller, nominal_at, reference, vehicle, trim_tables, gains):
    """At 50 s the bank steps by 46 deg, and the bank's share of the path error with it."""
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
    ramped = mission.model_copy(update={"manoeuvre": mission.manoeuvre.model_copy(update={"bank_time": 2.0})})
    knots = np.concatenate([piece.knots for piece in make_lqr_models(5.0, ramped, reference, vehicle, trim_tables)])
    for first in (0, 4800):
        assert set(range(first, first + 200, 10)) <= set(knots)
    assert len(knots) < 70  # each 5 s elsewhere


def test_attitude_slopes_by_hand(nominal_at, vehicle):
    """Entries that textbooks give: damping and effectiveness over the inertia, from the real-valued tables."""
    nominal = nominal_at(2500)
    A, B = longitudinal_model(attitude_slopes(vehicle, nominal))
    constants = vehicle.constants
    q_bar = 0.5 * nominal.around.density * nominal.speed**2

    def pitching_moment(**others: float) -> float:
        values = {
            "mach": nominal.speed / nominal.around.sound_speed,
            "angle_of_attack": nominal.angle_of_attack,
            "equivalence_ratio": nominal.equivalence_ratio,
            "elevator": nominal.elevator,
            "mass": nominal.mass,
        } | others
        return float(evaluate_coefficients(vehicle, make_variables(vehicle, **values))[4, 0])

    inertia = float(evaluate_fixed(vehicle, make_variables(vehicle, mass=nominal.mass))["inertia_yy"][0])
    scale = q_bar * constants.area * constants.chord / inertia
    d = 1e-4
    effectiveness = (pitching_moment(elevator=nominal.elevator + d) - pitching_moment()) / d
    damping = (pitching_moment(pitch_rate_hat=d) - pitching_moment()) / d * constants.chord / (2.0 * nominal.speed)
    assert B[1, 0] == pytest.approx(scale * effectiveness, rel=1e-6)
    assert A[1, 1] == pytest.approx(scale * damping, rel=1e-6)
    assert A[0, 1] == pytest.approx(1.0, abs=1e-3)
    assert B[0, 0] < 0.0  # more lift, less rate of angle of attack
