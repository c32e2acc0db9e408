"""The second vehicle flies: elevons, three-dimensional tables, centre of gravity aft of the moment reference."""

import math

import numpy as np
import pytest

from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import prepare
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.trim import FlightPoint, trim
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.world.atmosphere import atmosphere
from abhv_mc.world.earth import WGS84

BOX = {"atmosphere.density": 0.10, "aero.lift": 0.10, "aero.drag": 0.15}


@pytest.mark.parametrize("mission", ["level", "turn", "level_mach15", "turn_mach15"])
def test_flies_level_and_turns_at_both_points(repository, mission):
    """The nominal flight and the corners of the paper's box, with the gains of the paper's Table 1."""
    configs = repository / "configs"
    vehicle, controller = configs / "vehicle/winged_cone.yaml", configs / "control/tlc.yaml"
    plan = prepare(vehicle, configs / f"mission/{mission}.yaml", controller, "tlc")
    parameters = nominal_parameters(9)
    for corner in range(8):
        for bit, (name, half_width) in enumerate(BOX.items()):
            parameters[1 + corner, PARAMETER_INDEX[name]] += half_width * (1 if corner >> bit & 1 else -1)
    block = fly(plan, parameters)
    metric = {name: block.metrics[:, i] for name, i in METRIC_INDEX.items()}
    assert block.outcome.tolist() == [Outcome.OK] * 9
    # Nominal, then worst of the corners; measured 7.4 and 26 m, 0.014 and 0.6 m/s, 0.014 and 0.04 deg.
    assert metric["altitude_error_max_m"][0] < 10.0
    assert metric["altitude_error_max_m"].max() < 40.0
    assert metric["speed_error_max_mps"][0] < 0.05
    assert metric["speed_error_max_mps"].max() < 1.0
    assert metric["angle_of_attack_error_rms_deg"].max() < 0.1
    assert metric["sideslip_max_deg"].max() < 0.02
    assert metric["surface_saturation_s"].max() == 0.0
    assert metric["outside_tables_s"].max() == 0.0


def test_trims_near_the_published_angle_of_attack(repository):
    """1.7 to 1.8 deg at Mach 15, 110,000 ft and 300,000 lb; Marrison and Stengel, JGCD 21 (1998): 1.79 deg."""
    vehicle = load_vehicle(repository / "configs/vehicle/winged_cone.yaml")
    still = WGS84._replace(rotation_rate=0.0)
    altitude = 33.5e3
    found = trim(vehicle, still, FlightPoint(altitude, 15.0 * atmosphere(altitude)[3]))
    assert not found.fault
    assert 1.7 < math.degrees(found.angle_of_attack) < 1.8
    assert abs(math.degrees(found.elevator)) < 15.0
    assert np.isclose(found.mach, 15.0)
