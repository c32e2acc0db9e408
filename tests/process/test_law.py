"""Control laws in programs: one process for each flight, one request for each control tick."""

import json
import shutil
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from short_flights import disperse, short_plan, write_law

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.io.messages import InputError, InputErrors
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX
from abhv_mc_vehicle.stability.points import flown_points

INSIDE = """\
from typing import NamedTuple
from abhv_mc.extend import Command, controller

class Memory(NamedTuple):
    distance: float = 0.0

@controller
def law(measured, reference, memory):
    path = measured.flight_path_angle - reference.flight_path_angle
    angle = measured.angle_of_attack - reference.angle_of_attack + 0.9 * path
    bank = measured.bank - reference.bank
    speed = measured.speed - reference.speed
    p, q, r = measured.roll_rate, measured.pitch_rate, measured.yaw_rate
    command = Command(
        -0.26 * bank - 1.2 * measured.sideslip - 0.08 * p + 0.06 * r,
        -0.04 * bank - 0.2 * measured.sideslip - 0.01 * p + 0.04 * r,
        reference.elevator + 2.0 * angle + 1.5 * q,
        reference.equivalence_ratio - 0.02 * speed - 0.001 * memory.distance,
    )
    return command, Memory(memory.distance + 0.01 * speed)
"""
SCRIPT = """\
import json, os, sys, time
number = 0
for line in sys.stdin:
    request, number = json.loads(line), number + 1
    with open(sys.argv[1], "a") as log:
        log.write(f"{os.getpid()} {os.getcwd()} {os.listdir()} {request['time']}\\n")
    reply = {"aileron": 0.0, "rudder": 0.0, "elevator": -0.01, "equivalence_ratio": 0.85}
    FAULT
    print(json.dumps(reply), flush=True)
"""


def write_script(folder, fault="", **entries):
    """Write a law in a Python program that logs each request to 'log'."""
    (folder / "law.py").write_text(SCRIPT.replace("FAULT", fault))
    (folder / "table.csv").write_text("1\n")
    command = [sys.executable, "law.py", str(folder / "log")]
    content = {"law": "process", "command": command, "files": ["*.csv"], **entries}
    (folder / "law.yaml").write_text(json.dumps(content))
    return folder / "law.yaml"


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_c_program_of_the_page_gives_the_flights_of_a_law_inside(repository, tmp_path):
    for name in ("autopilot.c", "autopilot.yaml"):
        shutil.copy(repository / "docs/how-to" / name, tmp_path)
    assert (tmp_path / "autopilot.c").read_text().count("\n") <= 30
    build = ["cc", "-Wall", "-Werror", "-O2", "-ffp-contract=off", "-o", "autopilot", "autopilot.c"]
    subprocess.run(build, cwd=tmp_path, check=True)
    parameters = disperse(70)  # more flights than processes
    plans = [
        short_plan(200, path, "level")
        for path in (tmp_path / "autopilot.yaml", write_law(tmp_path, INSIDE))
    ]
    blocks = [fly(plan, parameters, 10) for plan in plans]
    for name in ("outcome", "end_time", "metrics", "history"):
        np.testing.assert_array_equal(*(getattr(block, name) for block in blocks), err_msg=name)
    assert 0 < (blocks[0].outcome == Outcome.OK).sum() < 70


def test_each_flight_has_a_process_and_a_folder_and_each_tick_one_request(tmp_path):
    plan = short_plan(4, write_script(tmp_path), "level")
    (tmp_path / "log").unlink()
    fly(plan, nominal_parameters(3))
    lines = [line.split(maxsplit=2) for line in (tmp_path / "log").read_text().splitlines()]
    assert [*Counter(process for process, *_ in lines).values()] == 3 * [5]
    assert len({folder for _, folder, _ in lines}) == 3
    assert all("table.csv" in files and "law.yaml" not in files for *_, files in lines)


@pytest.mark.parametrize(
    ("fault", "outcome"),
    [
        ("os._exit(3)", Outcome.LAW_CRASHED),
        ("time.sleep(60.0)", Outcome.LAW_HUNG),
        ("reply['rudder'] = 'left'", Outcome.LAW_FAILED),
        ("del reply['rudder']", Outcome.LAW_FAILED),
        ("print('hello')", Outcome.LAW_FAILED),
        ("reply['rudder'] = float('nan')", Outcome.NOT_FINITE),
    ],
)
def test_a_fault_ends_only_its_flight(tmp_path, fault, outcome):
    fault = f"if number == 3 and request['measured.bank'] > 0.05: {fault}"
    plan = short_plan(5, write_script(tmp_path, fault, time_limit="3 s"), "level")
    rows = nominal_parameters(2)
    rows[1, PARAMETER_INDEX["initial.bank"]] = 0.1
    assert fly(plan, rows).outcome.tolist() == [Outcome.OK, outcome]


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"inputs": ["measured.bnak"]}, "measured.bank"),
        ({"outputs": ["aileron", "rudder", "elevator"]}, "equivalence_ratio"),
        ({"outputs": ["aileron", "rudder", "elevator", "equivalence_ratio", "flap"]}, "flap"),
        ({"command": ["no_such_program_of_ours"]}, "law returned an error"),
        ({"command": ["cat"], "files": []}, "name no file"),
        ({"files": ["*.txt"]}, "matches no file"),
    ],
)
def test_what_a_controller_file_lacks_is_named(tmp_path, entries, message):
    path = write_script(tmp_path, **entries)
    with pytest.raises((InputError, InputErrors), match=message):
        short_plan(2, path, "level")


def test_a_program_has_no_linear_model(tmp_path):
    plan = short_plan(2, write_script(tmp_path), "level")
    with pytest.raises(InputError, match="linearization"):
        flown_points(plan, nominal_parameters(), 0.01)
