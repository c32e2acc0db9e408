"""C++ twin of the plant with the LQR law: ``twin/*.hpp``, compiled by ``g++ -O3 -march=native``.

It simulates the same equations, tables and gains one flight at a time, with libm, and without
metrics, gusts, turbulence, density profile, wind table, failures, inlet, sensor noise and delay.
"""

import subprocess
import tempfile
from pathlib import Path

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.flight.plan import FlightPlan
from benchmarks.peers.peer import read_work, write_result

SOURCE = Path(__file__).parent / "twin"
UNKNOWN = ("atmosphere.density_at", "wind.gust", "wind.turbulence", "sensor.delay", "failure.")
FLAGS = ("-std=c++17", "-O3", "-march=native")


def write_names(path: Path) -> None:
    """Write a header with the position of every name in the arrays."""
    from abhv_mc_vehicle.kernel.laws.columns import (
        LQR_ELEVATOR,
        LQR_GAINS,
        LQR_GUIDANCE,
        LQR_LATERAL,
        REFERENCE,
    )
    from abhv_mc_vehicle.kernel.plant.actuator_step import COLUMNS, SUBSTEPS
    from abhv_mc_vehicle.kernel.plant.state import STATES
    from abhv_mc_vehicle.kernel.plant.vehicle import (
        FIXED_TABLE_ROWS,
        PARAMETER_INDEX,
        VARIABLES,
        Constants,
    )
    from abhv_mc_vehicle.kernel.world.earth import Earth

    groups: dict[str, tuple[str, ...]] = {
        "constants": Constants._fields,
        "actuator": COLUMNS,
        "earth": Earth._fields,
        "state": STATES,
        "parameter": tuple(PARAMETER_INDEX),
        "variable": VARIABLES,
        "fixed_row": FIXED_TABLE_ROWS,
        "reference": REFERENCE,
    }
    lines = ["#pragma once"]
    for group, names in groups.items():
        positions = ", ".join(f"{name.replace('.', '_')} = {i}" for i, name in enumerate(names))
        lines.append(f"namespace {group} {{ enum : int {{ {positions}, count = {len(names)} }}; }}")
    gains = (
        f"guidance = {LQR_GUIDANCE}, elevator = {LQR_ELEVATOR}, lateral = {LQR_LATERAL}, count = "
        f"{len(LQR_GAINS)}"
    )
    lines.append(f"namespace actuators {{ constexpr int substeps = {SUBSTEPS}; }}")
    lines.append(f"namespace gain {{ enum : int {{ {gains} }}; }}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def compile_twin(folder: Path) -> Path:
    """Build the twin in a folder. Raise FileNotFoundError if g++ is missing."""
    write_names(folder / "names.hpp")
    program = folder / "twin"
    source = [f"-I{folder}", f"-I{SOURCE}", str(SOURCE / "main.cpp"), "-o", str(program)]
    subprocess.run(["g++", *FLAGS, *source], check=True)
    return program


def write_input(path: Path, plan: FlightPlan, parameters: Floats, states: Floats) -> None:
    """Write a plan as arrays of doubles, each after its length, in the order of ``input.hpp``.

    ``states`` [flight, state] are the initial states, including initial errors.
    """
    vehicle, timing = plan.vehicle, plan.timing
    tables = vehicle.tables._asdict()
    del tables["group_width"]  # spare rows
    arrays = [
        [
            value for value in vehicle.constants if not isinstance(value, tuple)
        ],  # inlet and load bounds come last
        vehicle.actuators.ravel(),
        plan.earth,
        *tables.values(),
        *vehicle.build_up,
        vehicle.effector_mix,
        timing,
        [value for value in plan.limits if not isinstance(value, tuple)],  # nor those of loads
        plan.reference,
        plan.gains,
        plan.settings,
        states,
        parameters,
    ]
    with path.open("wb") as file:
        for array in arrays:
            values = np.ascontiguousarray(array, dtype=np.float64).ravel()
            file.write(np.int64(values.size).tobytes() + values.tobytes())


def fly_twin(
    program: Path,
    plan: FlightPlan,
    parameters: Floats,
    starts: Floats,
    repeats: int = 0,
    keep: int = 0,
) -> tuple[list[float], Floats]:
    """Return seconds per flight of each repetition, and states [keep, tick, state].

    Stored flights must reach their end. Raise ValueError if a flight has a dispersion that the
    twin does not support.
    """
    from abhv_mc_vehicle.plant.parameters import PARAMETERS

    for i, parameter in enumerate(PARAMETERS):
        unknown = parameter.name.startswith(UNKNOWN) or parameter.name.endswith("_noise")
        if unknown and (parameters[:, i] != parameter.nominal).any():
            raise ValueError(f"the twin does not support {parameter.name}")
    plan_file, states_file = program.with_name("input.bin"), program.with_name("states.bin")
    write_input(plan_file, plan, parameters, starts)
    command = [str(program), str(plan_file), str(states_file), str(repeats), str(keep)]
    output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    states = np.fromfile(states_file).reshape(keep, -1, starts.shape[1])
    return [float(line) for line in output.split()], states


def main() -> None:
    work = read_work()
    with tempfile.TemporaryDirectory() as folder:
        starts = np.tile(work.plans["lqr"].initial_state, (len(work.parameters), 1))
        program = compile_twin(Path(folder))
        count = len(work.final_states)
        seconds, states = fly_twin(
            program, work.plans["lqr"], work.parameters, starts, work.repeats, count
        )
    difference = float(np.abs(states[:, -1, 0] - work.final_states[:, 0]).max())
    write_result("C++ twin", seconds, altitude_difference_m=difference)


if __name__ == "__main__":
    main()
