"""The model passed to the design of a control law is the vehicle that flies."""

import numpy as np
import pytest

import abhv_mc
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.user_code.design import INPUTS, STATES, DesignModel

EARTH = "earth: {rotation_rate: 0 rad/s, flattening: 0, j2: 0}"


@pytest.fixture(scope="module")
def sphere(tmp_path_factory):
    """Return the file of the S manoeuvre above a sphere that does not rotate."""
    text = shipped_configs().joinpath("mission/s_manoeuvre.yaml").read_text()
    assert "earth: wgs84" in text
    path = tmp_path_factory.mktemp("sphere") / "mission.yaml"
    path.write_text(text.replace("earth: wgs84", EARTH))
    return path


@pytest.fixture(scope="module")
def plan(sphere):
    return make_flight_plan(sphere, "ghame_x", "tlc")


@pytest.fixture(scope="module")
def model(sphere, plan):
    return DesignModel(plan.vehicle, read_mission(sphere), plan.reference, plan.vehicle.tables)


@pytest.mark.parametrize("time", [5.0, 45.0])
def test_the_linear_plant_is_that_of_the_flight_in_a_turn(sphere, model, time):
    """The flight has small sideslip and roll rates there, which the nominal turn has not."""
    flown = abhv_mc.linearize(sphere, "ghame_x", "tlc", at=time).plant_continuous
    plant = model.linearize(time)
    A, B = (flown.A.loc[list(STATES), list(names)].to_numpy() for names in (STATES, INPUTS))
    small = np.zeros(A.shape, bool)
    for row, column in [
        ("roll_rate", "angle_of_attack"), ("yaw_rate", "angle_of_attack"),
        ("angle_of_attack", "sideslip"), ("sideslip", "angle_of_attack"),
        ("pitch_rate", "yaw_rate"), ("yaw_rate", "pitch_rate"),
    ]:  # fmt: skip
        small[STATES.index(row), STATES.index(column)] = True
    assert np.abs(plant.A[small]).max() < 0.006
    np.testing.assert_allclose(np.where(small, 0.0, plant.A), np.where(small, 0.0, A), 0.05, 0.004)
    np.testing.assert_allclose(plant.B, B, 0.01, 5e-4)
    slow = np.ix_(range(2, 6), [0, 1, 3])  # altitude, speed and heading change the angles slowly
    np.testing.assert_allclose(plant.A[slow], A[slow], 0.08, 2e-7 if time < 10.0 else 2e-8)
    assert plant.states == STATES and plant.inputs == INPUTS


def test_selected_states_keep_their_order(model):
    plant = model.linearize(5.0)
    A, B = plant.take(("pitch_rate", "angle_of_attack"), ("elevator", "rudder"))
    assert A.tolist() == [[plant.A[8, 8], plant.A[8, 4]], [plant.A[4, 8], plant.A[4, 4]]]
    assert B.tolist() == [[plant.B[8, 2], plant.B[8, 1]], [plant.B[4, 2], plant.B[4, 1]]]


def test_the_trim_is_that_of_the_nearest_tick(model, plan):
    (tick,) = np.flatnonzero(np.isclose(model.time, 7.0))
    for time in (6.996, 7.004):
        assert model.trim(time) == (
            model.reference.angle_of_attack[tick],
            model.reference.bank[tick],
            model.reference.equivalence_ratio[tick],
            model.reference.elevator[tick],
        )
