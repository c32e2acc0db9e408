"""Tests of the state at which linearization starts.

It includes failures, sensors, wind and the engine, as in the kernel's memory.
"""

import numpy as np
import pytest
from vehicle.stability.systems import assert_predicted, flight_plan, parameters, read, steady_plan

from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.stability.analysis import analyse, make_rows
from abhv_mc_vehicle.stability.linearize import closed_loop, linearize
from abhv_mc_vehicle.stability.margins import NO_EFFECT, STUCK
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.steady import trim_points

# A difference of the throttle is one of the mass too, which is no state of the model: no fuel flow.
CALM = {"propulsion__specific_impulse": 1e9}
UNSTART = {
    "failure__engine__drag_increment": 1e-3,
    "failure__engine__pitching_moment_increment": 1e-5,
}
CASES = {
    "aileron loss": {"failure__aileron__loss_time": 1.0, "failure__aileron__effectiveness": 0.8},
    "elevator stuck": {"failure__elevator__stuck_time": 1.99},
    "rudder stuck elsewhere": {
        "failure__rudder__stuck_time": 1.95,
        "failure__rudder__stuck_at": 2e-4,
    },
    "aileron slow": {"failure__aileron__slow_time": 1.0, "failure__aileron__rate_limit": 0.5},
    "pitch rate frozen": {"failure__sensor__pitch_rate__time": 1.9},
    "engine weak": {"failure__engine__time": 1.0, "failure__engine__thrust": 0.9, **UNSTART},
    "crosswind": {"wind__north": 1.0, "wind__shear_north": 2e-5},
    "delayed and frozen": {"sensor__delay": 0.03, "failure__sensor__sideslip__time": 1.9},
}
QUICK = ("elevator stuck", "delayed and frozen")
SLOW = [pytest.param(name, marks=pytest.mark.thorough) for name in CASES if name not in QUICK]


@pytest.mark.parametrize("case", [*QUICK, *SLOW])
def test_the_maps_of_the_ticks_predict_the_flight_after_a_failure(case):
    plan = flight_plan("tlc", 4.0)
    assert_predicted(plan, parameters(**CALM, **CASES[case]), 200, 100)


def test_the_thrust_of_a_flame_out_decays_tick_by_tick():
    """Under the paper's LQR, which comes to no limit of the throttle within the second."""
    vehicle, mission, law = read("lqr")
    start = mission.start.model_copy(update={"altitude": 24e3})
    plan = make_plan(
        vehicle, mission.model_copy(update={"duration": 4.0, "start": start}), law, "lqr"
    )
    out = parameters(**CALM, failure__engine__time=2.0, failure__engine__thrust=0.0)
    assert_predicted(plan, out, 230, 100)


def test_each_ticks_map_is_the_next_ticks_along_the_s():
    """Compare the maps of two successive ticks.

    The reference moves between them, so they are only nearly equal.
    """
    vehicle, mission, law = read("tlc", "s_manoeuvre")
    plan = make_plan(vehicle, mission.model_copy(update={"duration": 12.0}), law, "tlc")
    for tick in (300, 1000):
        maps = [
            closed_loop(linearize(plan, flown_points(plan, parameters(), t * 0.01).points), 0)
            for t in (tick, tick + 1)
        ]
        np.testing.assert_allclose(maps[0], maps[1], rtol=0.0, atol=2e-3 * np.abs(maps[0]).max())
        assert_predicted(plan, parameters(**CALM), tick, 20)


def growing_pole(stability, system=0):
    assert not stability.stable[system]
    return stability.poles[system][0].real


def test_a_loss_in_flight_grows_as_the_same_loss_at_the_trim():
    plan, steady = flight_plan("tlc"), steady_plan("tlc")
    factor = parameters(control__aileron_effectiveness=0.5)
    expected = growing_pole(analyse(linearize(steady, trim_points(steady, factor).points)))
    assert expected == pytest.approx(4.19, abs=0.01)
    loss = parameters(failure__aileron__loss_time=29.0, failure__aileron__effectiveness=0.5)
    pole = growing_pole(analyse(linearize(plan, flown_points(plan, loss, 30.0).points)))
    assert pole == pytest.approx(expected, rel=0.03)


def test_a_stuck_surface_and_an_engine_that_is_out_have_no_loop():
    plan = flight_plan("lqr_retuned_ghame_x", 3.0)
    failed = parameters(2, failure__elevator__stuck_time=1.9)
    failed[1] = parameters(failure__engine__time=0.0)  # its thrust decays with the engine's lag
    linear = linearize(plan, flown_points(plan, failed, 2.9).points)
    np.testing.assert_array_equal(linear.cut, [[0, 0, STUCK, 0], [0, 0, 0, NO_EFFECT]])
    stability = analyse(linear)
    for system, (loop, reason) in enumerate(
        (("elevator", "stuck"), ("equivalence_ratio", "no effect"))
    ):
        row = next(
            row
            for row in make_rows("lqr_retuned_ghame_x", 2.9, stability, system)
            if row["loop"] == loop
        )
        assert row["reason"] == reason and row["phase_margin_deg"] is None


def test_the_trim_is_that_of_the_failed_vehicle_in_its_wind():
    steady = steady_plan("tlc")
    cases = parameters(4, wind__east=np.array([-60.0, 0.0, 0.0, 0.0]))
    cases[1] = parameters(failure__rudder__loss_time=0.0, failure__rudder__effectiveness=0.5)
    cases[2] = parameters(wind__north=20.0)
    cases[3] = parameters(failure__engine__time=0.0)
    trims = trim_points(steady, cases)
    assert trims.faults[:2] == ["", ""]
    # 60 m/s of head wind: less angle of attack and more elevator at the same speed over the ground.
    calm = trim_points(steady, parameters())
    assert trims.points.path[0, 4] < calm.points.path[0, 4] - 1e-4
    assert trims.points.controls[0, 2] < calm.points.controls[0, 2] - 1e-3
    np.testing.assert_allclose(
        trims.points.controls[1, 1], 2.0 * calm.points.controls[0, 1], rtol=1e-6
    )
    # The crab angle is a sideslip to the ground, which the law does not leave alone.
    assert np.rad2deg(trims.points.path[2, 5]) == pytest.approx(-0.82, abs=0.01)
    assert "-0.818 deg" in trims.faults[2]
    assert trims.faults[3] and "deg" not in trims.faults[3]
