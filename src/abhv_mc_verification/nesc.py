"""Fly the check-cases that a folder has data for and compare with every simulator given."""

import itertools
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flight.fly import nominal_parameters
from abhv_mc.io.input_error import InputError
from abhv_mc.kernel.flight.interface import Timing
from abhv_mc.kernel.plant.parameter_names import PARAMETER_INDEX
from abhv_mc.shipped import shipped_configs
from abhv_mc.user_code.vehicle_functions import load_vehicle
from abhv_mc_verification.check_rows import Row
from abhv_mc_verification.fly_recording import (
    at_times,
    check_times,
    make_motion,
    make_replay_plan,
    make_start,
    read_columns,
    replay,
    wrap_degrees,
)
from abhv_mc_verification.nesc_cases import CASES, FOOT, CheckCase, tolerances
from abhv_mc_verification.nesc_f16 import RATE, fly_aircraft, read_aircraft_cases

if TYPE_CHECKING:
    import pandas as pd

STEP = 0.01  # s, the product's default
_FILE = re.compile(r"Atmos_(\d\d(?:p\d)?)_sim_(\w+)\.csv(\.gz)?")
_NEEDED = 1.25  # times the largest difference of two simulators is allowed to the F-16, which has no limits of its own
_LIKE = 6  # the case whose tolerances are added: a body with aerodynamics on the ellipsoid
_LONGEST = 3600.0  # s

VELOCITY = [f"feVelocity_ft_s_{axis}" for axis in "XYZ"]  # north, east, down
EULER = [f"eulerAngle_deg_{angle}" for angle in ("Yaw", "Pitch", "Roll")]
RATES = [f"bodyAngularRateWrtEi_deg_s_{axis}" for axis in ("Roll", "Pitch", "Yaw")]
COLUMNS = ["time", "altitudeMsl_ft", "longitude_deg", "latitude_deg", *VELOCITY, *EULER, *RATES]


def find_files(folder: Path) -> dict[tuple[str, str], Path]:
    """Files by (case, simulator), a second one of both by its place. Raises :class:`InputError` where there is none."""
    if not folder.is_dir():
        raise InputError(folder, "no such folder", "a folder of check-cases")
    found: dict[tuple[str, str], Path] = {}
    known = {*(f"{number:02d}" for number in CASES), *read_aircraft_cases()}
    for path in sorted(folder.rglob("*.csv*")):
        match = _FILE.fullmatch(path.name)
        if match and match[1] in known:
            key = match[1], match[2]
            found[key if key not in found else (key[0], f"{key[1]} {path.relative_to(folder)}")] = (
                path
            )
    if not found:
        expected = "Atmos_NN_Name/Atmos_NN_sim_MM.csv of one of the cases 01 to 16"
        raise InputError(folder, "no check-case", expected)
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
    data: dict[tuple[str, str], pd.DataFrame] = {}
    for key, path in files.items():
        data[key] = read_columns(path, COLUMNS)
        times = np.array(data[key]["time"])
        check_times(path, times)
        if times[0] < 0.0 or times[-1] > _LONGEST:
            found = f"times {times[0]:g} to {times[-1]:g} s"
            raise InputError(path, found, f"times from 0 to at most {_LONGEST:g} s")
    rows: list[Row] = []
    for name in sorted({case for case, _ in data}):
        given = {simulator: columns for (case, simulator), columns in data.items() if case == name}
        duration = max(float(columns["time"].iloc[-1]) for columns in given.values())
        if name in read_aircraft_cases():
            step, allowed, states = (
                1.0 / RATE,
                allowed_difference(list(given.values())),
                fly_aircraft(name, duration),
            )
        else:
            step, allowed, states = (
                STEP,
                tolerances(int(name)),
                fly_case(CASES[int(name)], duration),
            )
        for simulator, columns in given.items():
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


def allowed_difference(given: "list[pd.DataFrame]") -> tuple[float, ...]:
    """Tolerances of a case of the F-16: 1.25 times what its simulators differ by at the times that they have in common.

    To that the tolerance is added that the quantity has in the cases of simple bodies. One simulator alone gives none:
    simulators 04 and 05, both right, differ by far more than those of simple bodies do.
    """
    if len(given) < 2:
        return (math.inf,) * len(_QUANTITIES)
    largest = np.zeros(len(_QUANTITIES))
    for one, other in itertools.combinations(given, 2):
        times, others = np.array(one["time"]), np.array(other["time"])
        place = np.minimum(np.searchsorted(others, times - 1e-6), others.size - 1)
        common = np.abs(others[place] - times) < 2e-6
        apart = _differences(_published(one[common]), _published(other.iloc[place[common]]))
        largest = np.maximum(largest, [np.abs(difference).max() for difference in apart])
    return tuple(_NEEDED * largest + tolerances(_LIKE))


def _published(columns: "pd.DataFrame") -> list[Floats]:
    """Altitude, velocity, longitude, latitude, Euler angles and body rates, in the units of the files."""
    names = ("altitudeMsl_ft", VELOCITY, "longitude_deg", "latitude_deg", EULER, RATES)
    return [np.array(columns[name]) for name in names]


def _flown(states: Floats) -> list[Floats]:
    """The same of states ``[time, state]``."""
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
_ANGLES = ("longitude", "euler_angles")  # which go round


def _differences(one: list[Floats], other: list[Floats]) -> list[Floats]:
    apart = [a - b for a, b in zip(one, other, strict=True)]
    return [
        wrap_degrees(difference) if name in _ANGLES else difference
        for (name, _), difference in zip(_QUANTITIES, apart, strict=True)
    ]


def _compare(
    case: str,
    simulator: str,
    given: "pd.DataFrame",
    states: Floats,
    allowed: tuple[float, ...],
    *,
    scale: float,
) -> list[Row]:
    apart = _differences(_flown(states), _published(given))
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
        for (name, unit), difference, tolerance in zip(_QUANTITIES, apart, allowed, strict=True)
    ]
