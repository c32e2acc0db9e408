"""Comparison with all published data: check-cases, recordings and papers."""

import math
from pathlib import Path

import numpy as np

from abhv_mc.campaign.file.check import read_campaign
from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_campaigns, shipped_configs
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.plant.trim import FlightPoint, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.check_rows import Row
from benchmarks.verification.ghame6 import verify_ghame6
from benchmarks.verification.nesc import verify_nesc

# published range in deg of the trim angle of attack at Mach 15 and 33.5 km
_PUBLISHED_TRIM = (1.7, 1.8)
_CONE_MISSIONS = ("level", "turn", "level_mach15", "turn_mach15")


def verify_paper(scale: float = 1.0) -> list[Row]:
    """Return verification rows for the trim and nominal missions of the winged cone.

    The trim is at Mach 15; the missions are simulated with TLC. `scale` multiplies the tolerances.
    For missions, the tolerances are the campaign's limits on tracking errors, which are taken from
    the axes of Figure 3 of Zhu and Shen (2014).
    """
    campaign = read_campaign(shipped_campaigns() / "winged_cone.yaml")
    requirements = [(campaign.metrics[item.metric], item.limits) for item in campaign.requirements]
    configs = shipped_configs()
    vehicle = load_vehicle(configs / "vehicle" / "winged_cone.yaml")
    controller = read_controller(configs / "control" / "tlc.yaml")
    start = read_mission(configs / "mission" / "level_mach15.yaml").start
    point = FlightPoint(start.altitude, start.speed, 0.0, start.latitude, start.heading, 0.0)
    trimmed = trim(vehicle, WGS84._replace(rotation_rate=0.0), point, None)
    middle = sum(_PUBLISHED_TRIM) / 2.0
    off = math.inf if trimmed.fault else abs(math.degrees(trimmed.angle_of_attack) - middle)
    rows = [
        Row(
            "winged_cone, trim",
            "published",
            "angle of attack",
            "deg",
            off,
            scale * (_PUBLISHED_TRIM[1] - middle),
        )
    ]
    for name in _CONE_MISSIONS:
        mission = read_mission(configs / "mission" / f"{name}.yaml")
        block = fly(make_plan(vehicle, mission, controller, "tlc"), nominal_parameters())
        flown = (
            block.metrics[0]
            if block.outcome[0] == Outcome.OK
            else np.full(len(METRIC_INDEX), np.inf)
        )
        for metric, limits in requirements:
            if metric.group == "tracking":
                difference, allowed = float(flown[METRIC_INDEX[metric.name]]), scale * limits.limit
                row = (f"winged_cone, {name}", "tlc, the reference", metric.name, metric.unit)
                rows.append(Row(*row, difference, allowed))
    return rows


def verify_everything(folder: Path, scale: float = 1.0) -> list[Row]:
    """Return verification rows for papers and the reference data in a folder.

    The folder contains ``nesc`` and ``cadac-ghame6``. `scale` multiplies the tolerances.
    """
    recordings = sorted((folder / "cadac-ghame6").glob("*.csv*"))
    if not recordings:
        raise InputError(
            folder, "the folder has no recording", "a CSV file in the subfolder cadac-ghame6"
        )
    rows = verify_nesc(folder / "nesc", scale)
    for recording in recordings:
        rows += verify_ghame6(recording, scale)
    return rows + verify_paper(scale)
