"""Simulation of NASA's check-cases, and comparison with published simulators."""

import itertools
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.timing import Timing
from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.fly import nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from benchmarks.verification.check_rows import Row
from benchmarks.verification.fly_recording import (
    at_times,
    check_times,
    make_motion,
    make_replay_plan,
    make_start,
    read_columns,
    replay,
    wrap_degrees,
)
from benchmarks.verification.nesc_cases import CASES, FOOT, CheckCase, tolerances
from benchmarks.verification.nesc_f16 import RATE, fly_aircraft, read_aircraft_cases

if TYPE_CHECKING:
    import pandas as pd

STEP = 0.01  # default integration step of abhv-mc in s
_FILE = re.compile(r"Atmos_(\d\d(?:p\d)?)_sim_(\w+)\.csv(\.gz)?")
# tolerance of F-16 cases relative to the largest difference between two simulators
_NEEDED = 1.25
_LIKE = 6  # number of the simple-body case whose tolerances are added
_LONGEST = 3600.0  # maximum duration of a case in s

VELOCITY = [f"feVelocity_ft_s_{axis}" for axis in "XYZ"]  # velocity north, east and down
EULER = [f"eulerAngle_deg_{angle}" for angle in ("Yaw", "Pitch", "Roll")]
RATES = [f"bodyAngularRateWrtEi_deg_s_{axis}" for axis in ("Roll", "Pitch", "Yaw")]
COLUMNS = ["time", "altitudeMsl_ft", "longitude_deg", "latitude_deg", *VELOCITY, *EULER, *RATES]


def find_files(folder: Path) -> dict[tuple[str, str], Path]:
    """Return files by (case, simulator). Raise InputError if the folder contains none."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "a folder of check-cases")
    files: dict[tuple[str, str], Path] = {}
    case_names = {*(f"{number:02d}" for number in CASES), *read_aircraft_cases()}
    for path in sorted(folder.rglob("*.csv*")):
        match = _FILE.fullmatch(path.name)
        if match and match[1] in case_names:
            key = match[1], match[2]
            files[key if key not in files else (key[0], f"{key[1]} {path.relative_to(folder)}")] = (
                path
            )
    if not files:
        expected = "files Atmos_NN_Name/Atmos_NN_sim_MM.csv of the cases 01 to 16"
        raise InputError(folder, "the folder has no check-cases", expected)
    return dict(sorted(files.items()))


def fly_case(case: CheckCase, duration: float, step: float = STEP) -> Floats:
    """Simulate a check-case and return its states [step, state]."""
    vehicle = load_vehicle(shipped_configs() / "vehicle" / "nesc" / f"{case.vehicle}.yaml")
    mass = vehicle.constants.mass_start
    start = make_start(case.altitude, case.velocity_ned, case.heading, case.rates, mass)
    parameters = nominal_parameters()[0]
    for name, value in case.parameters.items():
        parameters[PARAMETER_INDEX[name]] = value
    timing = Timing(step, 1, max(1, math.ceil(duration / step - 1e-6)))
    plan = make_replay_plan(vehicle, case.earth, start, np.zeros((timing.ticks + 1, 4)), timing)
    return replay(plan, parameters)


def verify_nesc(folder: Path, scale: float = 1.0) -> list[Row]:
    """Return rows for each case and simulator in a folder; `scale` multiplies tolerances."""
    files = find_files(folder)
    data: dict[tuple[str, str], pd.DataFrame] = {}
    for key, path in files.items():
        data[key] = read_columns(path, COLUMNS)
        times = np.array(data[key]["time"])
        check_times(path, times)
        if times[0] < 0.0 or times[-1] > _LONGEST:
            problem = f"the times range from {times[0]:g} to {times[-1]:g} s"
            raise InputError(path, problem, f"times from 0 to at most {_LONGEST:g} s")
    rows: list[Row] = []
    for name in sorted({case for case, _ in data}):
        tables = {simulator: columns for (case, simulator), columns in data.items() if case == name}
        duration = max(float(columns["time"].iloc[-1]) for columns in tables.values())
        if name in read_aircraft_cases():
            step, allowed, states = (
                1.0 / RATE,
                allowed_difference(list(tables.values())),
                fly_aircraft(name, duration),
            )
        else:
            step, allowed, states = (
                STEP,
                tolerances(int(name)),
                fly_case(CASES[int(name)], duration),
            )
        for simulator, columns in tables.items():
            rows.extend(
                _compare(
                    name,
                    simulator,
                    columns,
                    at_times(step, states, np.array(columns["time"])),
                    allowed,
                    scale=scale,
                )
            )
    return rows


def allowed_difference(tables: "list[pd.DataFrame]") -> tuple[float, ...]:
    """Return the tolerances of an F-16 case from the differences of its simulators.

    The tolerance is 1.25 times the largest difference at common times plus the tolerance of simple
    bodies. With a single simulator there is no tolerance: simulators 04 and 05 are both correct,
    but differ by far more than simulators do in the cases of simple bodies.
    """
    if len(tables) < 2:
        return (math.inf,) * len(_QUANTITIES)
    largest = np.zeros(len(_QUANTITIES))
    for first, second in itertools.combinations(tables, 2):
        times, second_times = np.array(first["time"]), np.array(second["time"])
        nearest = np.minimum(np.searchsorted(second_times, times - 1e-6), second_times.size - 1)
        common = np.abs(second_times[nearest] - times) < 2e-6
        differences = _differences(
            _published(first[common]), _published(second.iloc[nearest[common]])
        )
        largest = np.maximum(largest, [np.abs(difference).max() for difference in differences])
    return tuple(_NEEDED * largest + tolerances(_LIKE))


def _published(columns: "pd.DataFrame") -> list[Floats]:
    """Return the compared quantities of a file, in its units."""
    names = ("altitudeMsl_ft", VELOCITY, "longitude_deg", "latitude_deg", EULER, RATES)
    return [np.array(columns[name]) for name in names]


def _flown(states: Floats) -> list[Floats]:
    """Return the quantities of :func:`_published` from states [time, state]."""
    motion = make_motion(states)
    return [
        motion.altitude / FOOT,
        motion.velocity_ned / FOOT,
        np.degrees(motion.longitude),
        np.degrees(motion.latitude),
        np.degrees(motion.euler),
        np.degrees(motion.rates),
    ]


_QUANTITIES = (
    ("altitude", "ft"),
    ("velocity", "ft/s"),
    ("longitude", "deg"),
    ("latitude", "deg"),
    ("euler_angles", "deg"),
    ("body_rates", "deg/s"),
)
_ANGLES = ("longitude", "euler_angles")  # quantities that are angles and wrap around


def _differences(first: list[Floats], second: list[Floats]) -> list[Floats]:
    differences = [a - b for a, b in zip(first, second, strict=True)]
    return [
        wrap_degrees(difference) if name in _ANGLES else difference
        for (name, _), difference in zip(_QUANTITIES, differences, strict=True)
    ]


def _compare(
    case: str,
    simulator: str,
    recorded: "pd.DataFrame",
    states: Floats,
    allowed: tuple[float, ...],
    *,
    scale: float,
) -> list[Row]:
    differences = _differences(_flown(states), _published(recorded))
    title = f"nesc {case.replace('p', '.')}"
    return [
        Row(
            title,
            f"sim {simulator}",
            name,
            unit,
            float(np.abs(difference).max()),
            scale * tolerance,
        )
        for (name, unit), difference, tolerance in zip(
            _QUANTITIES, differences, allowed, strict=True
        )
    ]
