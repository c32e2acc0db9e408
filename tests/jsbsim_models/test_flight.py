"""Comparison of a flight of 30 s with JSBSim, extrapolated from two time steps."""

import math

import numpy as np
import pytest
from jsbsim_models.peer import FOOT, deflect, load, model

from abhv_mc.flights.timing import Timing
from abhv_mc_jsbsim.import_vehicle import import_jsbsim
from abhv_mc_vehicle.kernel.numerics.quaternion import from_euler
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.fly_recording import make_replay_plan, replay
from benchmarks.verification.nesc_cases import ELLIPSOID

DURATION, RADIUS = 30.0, 6.378e6
AILERON, RUDDER = math.radians(0.5), math.radians(-0.5)


def position(peer):
    """Return altitude, north and east, m."""
    latitude = peer["position/lat-geod-rad"]
    east = peer["position/long-gc-rad"] * RADIUS * math.cos(latitude)
    return np.array([peer["position/geod-alt-ft"] * FOOT, latitude * RADIUS, east])


def fly_peer(name, start, elevator, step):
    """Return the state at the start and the position at the end."""
    peer = load(name)
    peer.set_dt(step)
    peer["ic/h-sl-ft"], peer["ic/vt-fps"] = start
    for name_of_angle, angle in (("alpha", 3.0), ("beta", 1.0), ("phi", 10.0), ("psi-true", 40.0)):
        peer[f"ic/{name_of_angle}-deg"] = angle
    peer["ic/lat-geod-deg"], peer["ic/long-gc-deg"] = 30.0, 10.0
    deflect(peer, AILERON, RUDDER, elevator)
    peer.run_ic()
    x = np.zeros(s.N_STATES)
    x[s.ALTITUDE] = peer["position/geod-alt-ft"] * FOOT
    x[s.LONGITUDE], x[s.LATITUDE] = peer["position/long-gc-rad"], peer["position/lat-geod-rad"]
    x[s.Q0 : s.Q3 + 1] = from_euler(*(peer[f"attitude/{a}-rad"] for a in ("psi", "theta", "phi")))
    x[s.U : s.W + 1] = [peer[f"velocities/{axis}-fps"] * FOOT for axis in "uvw"]
    x[s.ROLL_RATE : s.YAW_RATE + 1] = [peer[f"velocities/{axis}i-rad_sec"] for axis in "pqr"]
    for _ in range(round(DURATION / step)):
        peer.run()
    return x, position(peer)


@pytest.mark.parametrize(
    ("name", "start", "elevator"),
    [
        ("X15", (6e4, 2500.0), -4.0),
        ("Shuttle", (6e4, 2500.0), 0.0),
        ("x24b", (5e4, 1500.0), -2.0),
    ],
)
def test_a_flight_equals_that_of_jsbsim(name, start, elevator, tmp_path):
    import_jsbsim(model(name), tmp_path)
    vehicle = load_vehicle(tmp_path / "vehicle.yaml")
    angle = math.radians(elevator)
    x, coarse = fly_peer(name, start, angle, 1e-3)
    _, fine = fly_peer(name, start, angle, 5e-4)
    theirs = 2.0 * fine - coarse  # the error of JSBSim is of first order in the step
    x[s.MASS] = vehicle.constants.mass_start
    ticks = round(DURATION / 0.01)
    controls = np.tile([AILERON, RUDDER, angle, 0.0], (ticks + 1, 1))
    last = replay(make_replay_plan(vehicle, ELLIPSOID, x, controls, Timing(0.01, 1, ticks)))[-1]
    east = last[s.LONGITUDE] * RADIUS * math.cos(last[s.LATITUDE])
    ours = np.array([last[s.ALTITUDE], last[s.LATITUDE] * RADIUS, east])
    print(name, ours - theirs, fine - coarse)
    assert np.linalg.norm(ours - theirs) < 0.1
