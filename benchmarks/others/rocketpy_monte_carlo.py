"""Monte Carlo simulation of a sounding rocket by RocketPy, the source of the imported table.

    python -m benchmarks.others.rocketpy_monte_carlo fly FILE [--flights 600]

The command needs RocketPy[sensitivity].
    python -m benchmarks.others.rocketpy_monte_carlo numbers

The first command writes FILE.inputs.txt and FILE.outputs.txt as lines of JSON, which
`benchmarks.others.rocketpy_table` converts to a table. The rocket is that of the speed comparison;
its dispersions are also in `rocketpy.yaml`. The second command writes RocketPy's results for the
table: medians and quantiles with bootstrap intervals, and the variance that its sensitivity model
attributes to each input.
"""

import argparse
import csv
from pathlib import Path
from typing import Any

import numpy as np
from rocketpy import Environment, Flight, MonteCarlo, SensitivityModel
from rocketpy.stochastic import (
    StochasticEnvironment,
    StochasticFlight,
    StochasticNoseCone,
    StochasticRocket,
    StochasticSolidMotor,
    StochasticTrapezoidalFins,
)

from benchmarks.document import write_json
from benchmarks.peers.rocketpy_flight import make_rocket

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "tests" / "reference" / "rocketpy" / "monte_carlo.csv"
NUMBERS = ROOT / "benchmarks" / "results" / "others_rocketpy_theirs.json"
INPUTS = {  # nominal value and standard deviation
    "mass": (14.426, 0.25),
    "total_impulse": (5850.0, 120.0),
    "burn_out_time": (3.9, 0.1),
    "power_off_drag_factor": (1.0, 0.06),
    "wind_velocity_x_factor": (1.0, 0.4),
    "inclination": (85.0, 0.8),
    "heading": (0.0, 2.0),
}
METRICS = ("apogee", "out_of_rail_velocity")


def fly(file: str, flights: int) -> None:
    """Run the flights with RocketPy's random numbers."""
    environment = Environment(latitude=32.99, longitude=-106.97, elevation=1400.0)
    environment.set_atmospheric_model(type="custom_atmosphere", wind_u=6.0, wind_v=0.0)
    rocket = make_rocket()
    flight = Flight(
        rocket=rocket, environment=environment, rail_length=5.2, inclination=85.0, heading=0.0
    )
    motor = StochasticSolidMotor(
        solid_motor=rocket.motor,
        total_impulse=INPUTS["total_impulse"],
        burn_out_time=INPUTS["burn_out_time"],
    )
    dispersed = StochasticRocket(
        rocket=rocket, mass=INPUTS["mass"], power_off_drag_factor=INPUTS["power_off_drag_factor"]
    )
    dispersed.add_motor(motor)
    dispersed.add_nose(StochasticNoseCone(nosecone=rocket.nosecones[0]))
    dispersed.add_trapezoidal_fins(StochasticTrapezoidalFins(trapezoidal_fins=rocket.fins[0]))
    air = StochasticEnvironment(
        environment=environment, wind_velocity_x_factor=INPUTS["wind_velocity_x_factor"]
    )
    launch = StochasticFlight(
        flight=flight, inclination=INPUTS["inclination"], heading=INPUTS["heading"]
    )
    study = MonteCarlo(filename=file, environment=air, rocket=dispersed, flight=launch)
    study.simulate(flights, include_function_data=False)


def find_numbers() -> dict[str, Any]:
    """Return RocketPy's results for the stored table."""
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    study = MonteCarlo.__new__(MonteCarlo)  # with results only, as after reading a file
    study.results = {name: [float(row[name]) for row in rows] for name in METRICS}
    numbers: dict[str, Any] = {name: {} for name in METRICS}
    for name in METRICS:
        for share in (0.5, 0.05):

            def quantile(x: np.ndarray, axis: int | None = None, share: float = share) -> Any:
                return np.quantile(x, share, axis=axis)

            interval = study.estimate_confidence_interval(name, statistic=quantile, random_state=0)
            value = float(quantile(study.results[name]))
            numbers[name][f"{share:g}"] = [value, float(interval.low), float(interval.high)]
    model = SensitivityModel(list(INPUTS), list(METRICS))
    model.set_parameters_nominal(
        *(np.array(column) for column in zip(*INPUTS.values(), strict=True))
    )
    table = np.array([[float(row[name]) for name in INPUTS] for row in rows])
    model.fit(table, np.array([[float(row[name]) for name in METRICS] for row in rows]))
    for name in METRICS:
        shares = model.target_variables_info[name]["sensitivity"]
        numbers[name]["variance"] = {key: float(shares[key]) for key in INPUTS}
    return numbers


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=["fly", "numbers"])
    parser.add_argument("file", nargs="?")
    parser.add_argument("--flights", type=int, default=600)
    arguments = parser.parse_args()
    if arguments.action == "fly":
        fly(arguments.file, arguments.flights)
    else:
        write_json(NUMBERS, find_numbers())


if __name__ == "__main__":
    main()
