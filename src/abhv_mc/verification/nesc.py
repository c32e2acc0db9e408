"""Fly the check-cases that a folder has data for and compare with every simulator given."""

import math
import os
import re
from itertools import chain, islice
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.flight.plan import Timing
from abhv_mc.io.input_error import InputError
from abhv_mc.plant.parameters import PARAMETER_INDEX
from abhv_mc.plant.vehicles import load_vehicle
from abhv_mc.shipped import shipped_configs
from abhv_mc.verification.nesc_cases import CASES, FOOT, CheckCase, tolerances
from abhv_mc.verification.recording import check_times, read_columns, stack_columns
from abhv_mc.verification.replay import at_times, make_motion, make_replay_plan, make_start, replay, wrap_degrees
from abhv_mc.verification.rows import Row

STEP = 0.01  # s, the product's default
_FILE = re.compile(r"Atmos_(\d\d)_sim_(\w+)\.csv(\.gz)?")
_LONGEST = 3600.0  # s

VELOCITY = [f"feVelocity_ft_s_{axis}" for axis in "XYZ"]  # north, east, down
EULER = [f"eulerAngle_deg_{angle}" for angle in ("Yaw", "Pitch", "Roll")]
RATES = [f"bodyAngularRateWrtEi_deg_s_{axis}" for axis in ("Roll", "Pitch", "Yaw")]
COLUMNS = ["time", "altitudeMsl_ft", "longitude_deg", "latitude_deg", *VELOCITY, *EULER, *RATES]


def find_files(folder: Path) -> dict[tuple[int, str], Path]:
    """Files by (case, simulator), wherever in the folder they lie; linked case folders too.

    A second file of the same case and simulator goes by its place. Raises :class:`InputError` where there is none.
    """
    if not folder.is_dir():
        raise InputError(folder, None, None, "no such folder", "a folder of check-cases")
    found: dict[tuple[int, str], Path] = {}
    links = (path for path in folder.iterdir() if path.is_symlink())
    # os.walk passes over what vanishes meanwhile, as processes of /proc do, and what is closed.
    levels = chain(os.walk(folder), *(islice(os.walk(link), 1) for link in links))
    for path in sorted(Path(place, name) for place, _, names in levels for name in names):
        match = _FILE.fullmatch(path.name)
        if match and int(match[1]) in CASES:
            key = int(match[1]), match[2]
            found[key if key not in found else (key[0], f"{key[1]} {path.relative_to(folder)}")] = path
    if not found:
        wanted = "Atmos_NN_Name/Atmos_NN_sim_MM.csv of one of the cases 01 to 10"
        raise InputError(folder, None, None, "no check-case", wanted)
    return dict(sorted(found.items()))


def fly_case(case: CheckCase, duration: float, step: float = STEP) -> Floats:
    """States ``[step, state]`` of a check-case, by the product's plant."""
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
    """Rows of every case and simulator in a folder; ``scale`` multiplies the tolerances."""
    files = find_files(folder)
    data: dict[tuple[int, str], dict[str, Floats]] = {}
    for key, path in files.items():
        data[key] = read_columns(path, COLUMNS)
        times = data[key]["time"]
        check_times(path, times)
        if times[0] < 0.0 or times[-1] > _LONGEST:
            found = f"times {times[0]:g} to {times[-1]:g} s"
            raise InputError(path, None, None, found, f"times from 0 to at most {_LONGEST:g} s")
    rows: list[Row] = []
    for number in sorted({case for case, _ in data}):
        given = {simulator: columns for (case, simulator), columns in data.items() if case == number}
        states = fly_case(CASES[number], max(float(columns["time"][-1]) for columns in given.values()))
        for simulator, columns in given.items():
            rows.extend(_compare(number, simulator, columns, states, scale))
    return rows


def _compare(number: int, simulator: str, given: dict[str, Floats], states: Floats, scale: float) -> list[Row]:
    motion = make_motion(at_times(STEP, states, given["time"]))

    allowed = tolerances(number)
    quantities = (
        ("altitude", "ft", motion.altitude / FOOT - given["altitudeMsl_ft"], allowed.altitude),
        ("velocity", "ft/s", motion.velocity_ned / FOOT - stack_columns(given, VELOCITY), allowed.velocity),
        ("longitude", "deg", wrap_degrees(np.degrees(motion.longitude) - given["longitude_deg"]), allowed.position),
        ("latitude", "deg", np.degrees(motion.latitude) - given["latitude_deg"], allowed.position),
        ("euler_angles", "deg", wrap_degrees(np.degrees(motion.euler) - stack_columns(given, EULER)), allowed.euler),
        ("body_rates", "deg/s", np.degrees(motion.rates) - stack_columns(given, RATES), allowed.rates),
    )
    return [
        Row(f"nesc {number:02d}", f"sim {simulator}", name, unit, float(np.abs(difference).max()), scale * tolerance)
        for name, unit, difference, tolerance in quantities
    ]
