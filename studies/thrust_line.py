"""Errors of TLC over those of LQR as the thrust line of abhv changes: studies/thrust_line.json.

    OPENBLAS_NUM_THREADS=1 python studies/thrust_line.py [--flights N] [--smoke]

The inclination and the offset of the thrust line are varied one at a time. Both laws have the
printed gains and weights, and the trim and the nominal flight are computed for each thrust line.
"""

import argparse
import json
from typing import Any

import numpy as np
from experiment import ROOT
from paper_vehicle_claim import ERRORS, compare, fly_law
from paper_vehicle_flights import LAWS
from paper_vehicle_sides import find_trim
from robust_flights import read_case

from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle

RESULTS = ROOT / "studies/thrust_line.json"
INCLINATIONS = (0.0, None, 10.0)  # deg; None is that of abhv
OFFSETS = (0.0, 0.1, 0.3)  # m below the centre of gravity; that of abhv is 0.167


def move_thrust_line(vehicle: Vehicle, angle: float | None, offset: float | None) -> Vehicle:
    """Return the vehicle with another inclination (deg) or offset (m) of its thrust line."""
    c = vehicle.constants
    if angle is not None:
        radians = np.deg2rad(angle)
        c = c._replace(thrust_cos=float(np.cos(radians)), thrust_sin=float(np.sin(radians)))
    if offset is not None:
        c = c._replace(thrust_offset_z=offset)
    return vehicle._replace(constants=c)


def measure_ratios(angle: float | None, offset: float | None, flights: int) -> dict[str, Any]:
    """Return the trim, and the ratios of the laws' median rms errors, with a thrust line."""
    vehicle, mission = read_case("abhv")
    vehicle = move_thrust_line(vehicle, angle, offset)
    flown, completed = {}, np.ones(flights + 1, dtype=bool)
    for law in LAWS:
        flown[law], ok = fly_law(vehicle, mission, law, flights)
        completed &= ok
    claim, _ = compare(flown, completed, mission)
    alpha, elevator, eta = find_trim(vehicle)
    c = vehicle.constants
    return {
        "inclination_deg": round(float(np.rad2deg(np.arctan2(c.thrust_sin, c.thrust_cos))), 2),
        "offset_m": round(c.thrust_offset_z, 3),
        "lost": int((~completed).sum()),
        "angle_of_attack_deg": round(float(np.rad2deg(alpha)), 3),
        "elevator_deg": round(float(np.rad2deg(elevator)), 3),
        "equivalence_ratio": round(eta, 4),
        **{
            window: {
                name: round(claim[window][name]["tlc"] / claim[window][name]["lqr"], 3)
                for name in ERRORS
            }
            for window in claim
        },
    }


def main() -> None:
    """Run the flights and write the results."""
    parser = argparse.ArgumentParser(description="Move the thrust line of abhv.")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        print(measure_ratios(INCLINATIONS[-1], None, 2))
        return
    results = []
    for angle, offset in [*((a, None) for a in INCLINATIONS), *((None, x) for x in OFFSETS)]:
        results.append(measure_ratios(angle, offset, arguments.flights))
        print(results[-1], flush=True)
        RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
