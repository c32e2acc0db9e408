"""Flights near a pole and across the date line."""

import math

import numpy as np
import pytest
from verification.independent import FT, World, fly_sphere

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.flights.timing import Timing
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.fly_recording import make_motion, make_replay_plan, make_start, replay
from benchmarks.verification.nesc_cases import ELLIPSOID

CONFIGS = shipped_configs()


def test_a_body_flies_past_the_pole_as_in_cartesian_coordinates():
    """Pass the pole at 0.8 km, where meridian and course turn by a right angle within seconds."""
    velocity = (700.0, 700.0, -1000.0)  # ft/s
    expected = np.array(fly_sphere(World(), 0.0, velocity, latitude=89.99))[:, 1:7]
    vehicle = load_vehicle(CONFIGS / "vehicle" / "nesc" / "sphere.yaml")
    start = make_start(
        0.0,
        tuple(FT * v for v in velocity),
        0.0,
        (0.0, 0.0, 0.0),
        vehicle.constants.mass_start,
        latitude=math.radians(89.99),
    )
    timing = Timing(0.01, 1, 3000)
    motion = make_motion(
        replay(make_replay_plan(vehicle, ELLIPSOID, start, np.zeros((3001, 4)), timing))[::10]
    )
    assert np.degrees(motion.latitude).max() > 89.992
    assert (
        np.abs(motion.altitude / FT - expected[:, 0]).max() < 5e-3
    )  # as at the equator: constants of the air
    metres = np.radians(90.0 - expected[:, 2]) * 6.4e6  # from the pole
    turned = (np.degrees(motion.longitude) - expected[:, 1] + 180.0) % 360.0 - 180.0
    assert np.abs(np.radians(turned) * metres).max() < 1e-3
    assert np.abs(np.degrees(motion.latitude) - expected[:, 2]).max() < 1e-8
    assert np.abs(motion.velocity_ned / FT - expected[:, 3:6]).max() < 1e-3


def plan_from(heading, latitude, longitude=0.0):
    """Return the plan of 20 s of level flight; angles in degrees."""
    angles = {"heading": heading, "latitude": latitude, "longitude": longitude}
    start = {f"start.{name}": f"{value} deg" for name, value in angles.items()}
    return make_flight_plan({"base": "level", "duration": "20 s", **start}, "ghame_x")


@pytest.mark.parametrize("sign", [1, -1])
def test_a_flight_over_the_pole_ends_at_the_pole_limit(sign):
    plan = plan_from(0.0 if sign > 0 else 180.0, sign * 89.9)
    block = fly(plan, nominal_parameters(), 100, keep_states=True)
    assert block.outcome.tolist() == [Outcome.POLE_LIMIT]
    assert block.end_time[0] == pytest.approx(math.radians(0.095) * 6.42e6 / 1400.0, abs=0.1)
    assert np.isfinite(block.states[0, : int(block.end_time[0]) + 1]).all()


def test_a_mission_starts_up_to_89_99_deg():
    assert plan_from(0.0, 89.99).initial_state[s.LATITUDE] == math.radians(89.99)


def test_the_date_line_changes_longitude_alone():
    greenwich, date_line = (plan_from(90.0, 10.0, longitude) for longitude in (0.0, 179.9))
    states = [
        fly(plan, nominal_parameters(), 100, keep_states=True).states[0]
        for plan in (greenwich, date_line)
    ]
    other_states = [i for i in range(s.N_STATES) if i != s.LONGITUDE]
    assert np.array_equal(states[0][:, other_states], states[1][:, other_states])
    turned = states[1][:, s.LONGITUDE] - states[0][:, s.LONGITUDE] - math.radians(179.9)
    assert states[1][-1, s.LONGITUDE] < -3.0
    assert np.abs((turned + 1.0) % math.tau - 1.0).max() < 1e-12
