"""Several engines: a failure of each by itself yaws and pitches the vehicle."""

import numpy as np
import pytest
from short_flights import rows_of, short_plan

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.plant import state as s
from abhv_mc.vehicle.evaluate import evaluate_fixed, make_variables


def make_plan(engines):
    return short_plan(100, mission="level", vehicle={"base": "ghame_x", "propulsion.engines": engines})


@pytest.fixture(scope="module")
def plan():
    left, right = ({"share": 0.4, "y": y, "z": "-0.1 m"} for y in ("-0.6 m", "0.6 m"))
    return make_plan({"left": left, "right": right, "below": {"share": 0.2, "z": "0.4 m"}})


def fly_cases(plan, *cases):
    return fly(plan, rows_of(*cases), 1, keep_states=True)


def test_an_engine_out_takes_its_share_and_turns_the_vehicle(plan) -> None:
    """The change of the body rates over the first tick against moment over inertia."""
    block = fly_cases(plan, {}, {"failure.engine_0.time": 0.0}, {"failure.engine_2.time": 0.0})
    thrust = block.history[:, :, CHANNEL_INDEX["thrust_n"]].astype(float)
    eta = block.history[:, :, CHANNEL_INDEX["equivalence_ratio"]].astype(float)
    # TLC asks for more, at another angle of attack, where the inlet captures more.
    assert thrust[1, 60] / thrust[0, 60] / (eta[1, 60] / eta[0, 60]) == pytest.approx(0.6, abs=0.05)
    # The first tick: thrust falls by the mean of 1 - exp(-t / lag), and nothing has answered yet.
    lag = 2.0 * 1.0 / 20.0
    lost = 1.0 - lag / 0.01 * (1.0 - np.exp(-0.01 / lag))
    vehicle = plan.vehicle
    fixed = evaluate_fixed(vehicle, make_variables(vehicle, mass=vehicle.constants.mass_start))
    whole = thrust[0, 0]
    for flight, share, y, z in ((1, 0.4, -0.6, -0.1), (2, 0.2, 0.0, 0.4)):
        assert thrust[flight, 0] == pytest.approx(whole * (1.0 - share * lost), rel=1e-6)
        change = (block.states[flight, 1] - block.states[0, 1])[s.ROLL_RATE : s.YAW_RATE + 1] / 0.01
        line = vehicle.constants.thrust_offset_z - fixed["center_of_gravity_z"][0]
        force = -whole * share * lost
        pitch, yaw = (line + z) * force / fixed["inertia_yy"][0], -y * force / fixed["inertia_zz"][0]
        assert change[1] == pytest.approx(pitch, rel=2e-2)
        assert change[2] == pytest.approx(yaw, rel=2e-2, abs=1e-6)


def test_all_engines_out_is_the_engine_out(plan) -> None:
    each = {f"failure.engine_{i}.time": 0.3 for i in range(3)}
    block = fly_cases(plan, each, {"failure.engine.time": 0.3}, {"failure.engine_3.time": 0.3}, {})
    assert np.abs(block.states[0] - block.states[1]).max() < 1e-9
    assert np.array_equal(block.states[2], block.states[3])  # there are three


@pytest.mark.parametrize(
    ("engines", "words"),
    [
        ({"left": {"y": "-1 m"}, "right": {"y": "2 m"}}, "acts"),
        ({"left": {"share": 0.4}, "right": {}}, "shares"),
    ],
)
def test_engines_that_do_not_make_the_whole_are_refused(engines, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make_plan(engines)
