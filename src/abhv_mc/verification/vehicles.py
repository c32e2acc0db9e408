"""Two vehicles and their controllers: the winged cone's trim and flights, and what each retuned LQR may use."""

import math

import numpy as np

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import read_mission
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.outcome import Outcome
from abhv_mc.flight.prepare import make_plan
from abhv_mc.flight.signals import METRIC_INDEX
from abhv_mc.plant.trim import FlightPoint, trim
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.verification.rows import Row
from abhv_mc.world.earth import WGS84

_PUBLISHED_TRIM = (1.7, 1.8)  # deg at Mach 15 and 33.5 km
_CONE_MISSIONS = ("level", "turn", "level_mach15", "turn_mach15")
_AXIS = {"altitude_error_max_m": 50.0, "speed_error_max_mps": 5.0}  # of Figure 3 of Zhu and Shen (2014)

RETUNED = {"ghame_x": "lqr_retuned", "ghame_x_coupled": "lqr_retuned_ghame_x_coupled", "ghame": "lqr_retuned_ghame"}
ALLOWED = 1.05  # times TLC's
USAGE = tuple(f"{surface}_{kind}_deg" for surface in ("aileron", "elevator", "rudder") for kind in ("rms", "travel"))


def verify_vehicles() -> list[Row]:
    """Rows of the winged cone's trim at Mach 15 and of its missions under TLC, nominal."""
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "winged_cone.yaml")
    start = read_mission(shipped_configs() / "mission" / "level_mach15.yaml").start
    point = FlightPoint(start.altitude, start.speed, 0.0, start.latitude, start.heading, 0.0)
    found = trim(vehicle, WGS84._replace(rotation_rate=0.0), point, None)
    middle = sum(_PUBLISHED_TRIM) / 2.0
    off = math.inf if found.fault else abs(math.degrees(found.angle_of_attack) - middle)
    rows = [Row("winged_cone, trim", "published", "angle of attack", "deg", off, _PUBLISHED_TRIM[1] - middle)]
    for mission in _CONE_MISSIONS:
        metrics = fly_nominal("winged_cone", mission, "tlc")
        case = f"winged_cone, {mission}"
        rows += [
            Row(case, "tlc, the reference", name, name.rsplit("_", 1)[1].replace("mps", "m/s"), metrics[name], allowed)
            for name, allowed in _AXIS.items()
        ]
    return rows


def verify_usage() -> list[Row]:
    """Rows of the largest of six usages of each retuned LQR over TLC's, nominal S."""
    rows = []
    for vehicle, retuned in RETUNED.items():
        ours, tlc = (fly_nominal(vehicle, "s_manoeuvre", name) for name in (retuned, "tlc"))
        worst = max(USAGE, key=lambda name: ours[name] / tlc[name])
        rows.append(
            Row(retuned, f"tlc, {vehicle}", f"most used: {worst}", "of TLC's", ours[worst] / tlc[worst], ALLOWED)
        )
    return rows


def fly_nominal(vehicle: str, mission: str, controller: str) -> dict[str, float]:
    """Metrics of a shipped mission, nothing dispersed; infinite where it ends early."""
    configs = shipped_configs()
    plan = make_plan(
        load_vehicle(configs / "vehicle" / f"{vehicle}.yaml"),
        read_mission(configs / "mission" / f"{mission}.yaml"),
        read_controller(configs / "control" / f"{controller}.yaml"),
        controller,
    )
    block = fly(plan, nominal_parameters())
    metrics = block.metrics[0] if block.outcome[0] == Outcome.OK else np.full(len(METRIC_INDEX), np.inf)
    return {name: float(metrics[i]) for name, i in METRIC_INDEX.items()}
