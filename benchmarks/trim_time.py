"""Time of the guidance trim of the S, which TLC would compute in flight: results/trim_time.json.

    python -m benchmarks.trim_time [--smoke]

The trim solves equation (12) of the paper at each of 6001 ticks of the S with `abhv`: with the
previous tick's solution as the start of the search (warm), and without it (cold). The shortest of
several repetitions counts.
"""

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np

from abhv_mc.shipped import find_input
from abhv_mc_vehicle.control.design.design_model import make_environment
from abhv_mc_vehicle.control.design.profile import make_profile
from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables, trim_along
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.kernel.laws.trim_lookup import GuidancePoints
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.timing import measure_time

RESULTS = Path(__file__).parent / "results/trim_time.json"
TICK = 0.01  # s


def measure(repetitions: int) -> dict[str, float]:
    """Return the shortest processor times of a warm and of a cold trim, microseconds."""
    vehicle = load_vehicle(find_input("abhv", "vehicle"))
    mission = read_mission(find_input("paper_s", "mission"))
    profile = make_profile(mission, np.arange(6001) * TICK)
    air = make_environment(mission.make_earth(), mission.start.altitude, mission.start.latitude)
    points = GuidancePoints(
        speed=profile.speed,
        density=air.density,
        sound_speed=air.sound_speed,
        gravity=air.gravity,
        radius=air.radius,
        latitude=mission.start.latitude,
        flight_path_angle=0.0,
        heading=profile.heading,
        axial=0.0,
        longitudinal=0.0,
        lateral=profile.speed * profile.heading_rate,
    )
    tables, mass = make_mission_trim_tables(mission, vehicle), vehicle.constants.mass_start
    shortest = {}
    for name, warm in (("warm_us", True), ("cold_us", False)):
        solve = partial(trim_along, vehicle, tables, points, mass, TICK, warm_start=warm)
        if solve().status.any():  # the first call may compile
            raise SystemExit("the S is not trimmed everywhere")
        seconds = [measure_time(solve) for _ in range(repetitions)]
        shortest[name] = round(1e6 * min(seconds) / profile.speed.size, 2)
    return shortest


def main() -> None:
    """Measure, and write the results."""
    parser = argparse.ArgumentParser(description="Measure the time of a guidance trim.")
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    smoke = parser.parse_args().smoke
    times = measure(1 if smoke else 50)
    print(times)
    if not smoke:
        RESULTS.write_text(json.dumps(times, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
