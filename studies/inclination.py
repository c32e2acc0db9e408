"""Errors of TLC over those of LQR as the thrust of abhv is inclined: studies/inclination.json.

    OPENBLAS_NUM_THREADS=1 python studies/inclination.py [--flights N] [--smoke]

Only the inclination of the thrust line changes. Both laws have the printed gains and weights, and
the trim and the nominal flight are computed for each inclination.
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

RESULTS = ROOT / "studies/inclination.json"
INCLINATIONS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0)  # deg


def incline(vehicle: Vehicle, angle: float) -> Vehicle:
    """Return the vehicle with its thrust inclined by an angle (deg)."""
    radians = np.deg2rad(angle)
    constants = vehicle.constants._replace(
        thrust_cos=float(np.cos(radians)), thrust_sin=float(np.sin(radians))
    )
    return vehicle._replace(constants=constants)


def measure_ratios(angle: float, flights: int) -> dict[str, Any]:
    """Return the trim, and the ratios of the laws' median rms errors, at an inclination (deg)."""
    vehicle, mission = read_case("abhv")
    vehicle = incline(vehicle, angle)
    flown, completed = {}, np.ones(flights + 1, dtype=bool)
    for law in LAWS:
        flown[law], ok = fly_law(vehicle, mission, law, flights)
        completed &= ok
    claim, _ = compare(flown, completed, mission)
    alpha, elevator, eta = find_trim(vehicle)
    return {
        "inclination_deg": angle,
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
    parser = argparse.ArgumentParser(description="Incline the thrust of abhv.")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--smoke", action="store_true", help="the least work; writes no result")
    arguments = parser.parse_args()
    if arguments.smoke:
        print(measure_ratios(INCLINATIONS[-1], 2))
        return
    results = []
    for angle in INCLINATIONS:
        results.append(measure_ratios(angle, arguments.flights))
        print(results[-1], flush=True)
        RESULTS.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
