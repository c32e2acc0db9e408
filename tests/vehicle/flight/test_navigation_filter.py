"""Tests of the shipped navigation filter's consistency: errors against their covariance.

A covariance that is wrong by a factor of two is detected.
"""

import math
import runpy

import numpy as np
import pytest
import yaml
from scipy.stats import chi2

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.shipped import find_input, shipped_campaigns, shipped_configs
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.prepare import prepare
from abhv_mc_vehicle.kernel.world.earth import WGS84, gravity_ned
from abhv_mc_vehicle.user_code.law_interface import Measured
from abhv_mc_vehicle.vehicle_simulator.make_plans import make_plans

FLIGHTS = 200
INSTANTS = (0.01, 2, 4, 8, 12, 16, 20, 24, 28, 33, 38, 43, 48, 53, 58)  # s
QUANTITIES = ("position", "velocity", "attitude")
LOW, HIGH = chi2.ppf([0.025, 0.975], 3 * FLIGHTS) / FLIGHTS
P = ("attitude_error", "gyro_bias", "acceleration_bias")
Q = ("gyro_noise", "acceleration_noise")


def test_at_rest_on_the_turning_earth_it_stays_where_it_is():
    """At rest, level and facing north no error grows.

    The specific force is minus gravity, and the body rates are those of the Earth.
    """
    names = runpy.run_path(str(shipped_configs() / "control" / "navigation.py"))
    law, latitude, dt = names["law"], 0.7, 0.01
    north, down = gravity_ned(WGS84, 100.0, math.sin(latitude), math.cos(latitude))
    still = dict.fromkeys(Measured._fields, 0.0) | {"altitude": 100.0, "latitude": latitude}
    still |= {"acceleration_x": -north, "acceleration_z": -down}
    still["roll_rate"] = WGS84.rotation_rate * math.cos(latitude)
    still["yaw_rate"] = -WGS84.rotation_rate * math.sin(latitude)
    measured, memory = Measured(**still), names["Memory"]()
    settings = names["Settings"](update_rate=0.2, speed_noise=0.3)
    for tick in range(300):  # not corrected within 5 s
        _, memory = law(measured, memory, settings, tick * dt, dt)
    assert abs(memory.latitude - latitude) * 6.4e6 < 1e-6
    assert abs(memory.altitude - 100.0) < 1e-6
    np.testing.assert_allclose(memory[3:6], 0.0, atol=1e-8)
    np.testing.assert_allclose(memory[6:10], [1.0, 0.0, 0.0, 0.0], atol=1e-9)
    assert memory.pp_00 > 25.0 and memory.vv_00 > 0.0 and memory.tt_00 > settings.attitude_error**2


def nees(folder, seed, factors=()):
    """Return the mean NEES [quantity, instant] of a campaign with changed filter settings."""
    law = yaml.safe_load(find_input("tlc_navigation", "control").read_text("utf-8"))
    law |= {name: str(shipped_configs() / "control" / law[name]) for name in ("file", "around")}
    for name, factor in factors:
        value, unit = law["settings"][name].split()
        law["settings"][name] = f"{factor * float(value)!r} {unit}"
    (folder / "law.yaml").write_text(yaml.safe_dump(law), "utf-8")
    file = shipped_campaigns() / "navigation.yaml"
    campaign = yaml.safe_load(file.read_text("utf-8"))
    campaign |= {"controllers": {"own": "law.yaml"}, "under_test": ["own"]}
    campaign |= {"seed": seed, "runs": FLIGHTS}
    for key in ("vehicle", "mission", "channels"):
        campaign[key] = str((file.parent / campaign[key]).resolve())
    campaign["metrics"] = {
        f"{name}_{i}": {"of": f"{name}_nees", "statistic": "final", "to": f"{time} s"}
        for name in QUANTITIES
        for i, time in enumerate(INSTANTS)
    }
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign), "utf-8")
    read = read_campaign(folder / "campaign.yaml")
    plan = make_plans(read, read.controllers, prepare)["own"]
    block = fly(plan, read.rows(read.make_samples().draw(0, FLIGHTS)))
    assert not block.outcome.any()
    names = [metric.name for metric in plan.metrics]
    rows = [[names.index(f"{name}_{i}") for i in range(len(INSTANTS))] for name in QUANTITIES]
    return block.metrics[:, rows].mean(axis=0)


def inside(means):
    """Return the share of means [..., instant] in the 95 % interval for 200 flights."""
    return ((means > LOW) & (means < HIGH)).mean(axis=-1)


@pytest.mark.thorough
def test_its_errors_are_those_of_its_covariance(tmp_path):
    means = np.concatenate([nees(tmp_path, seed) for seed in (1, 2, 3)], axis=1)
    assert (inside(means) >= 0.8).all(), means
    assert (round(LOW, 2), round(HIGH, 2)) == (2.67, 3.35)


@pytest.mark.thorough
@pytest.mark.parametrize("variance", [2.0, 0.5])
@pytest.mark.parametrize(("names", "quantity"), [(P, "attitude"), (Q, "velocity")])
def test_a_covariance_off_by_two_is_outside(tmp_path, names, quantity, variance):
    means = nees(tmp_path, 1, [(name, math.sqrt(variance)) for name in names])
    assert inside(means[QUANTITIES.index(quantity)]) < 0.8, means
