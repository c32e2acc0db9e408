"""Tests of the check-cases.

They compare with NASA's data or with an independent integration, and check published values.
"""

import gzip
import json
import shutil
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner
from verification.independent import FT, World, fly_sphere, write_case
from verification.shown import check

from abhv_mc.topics.formatting import json_data
from benchmarks.verification.__main__ import app
from benchmarks.verification.check_rows import Row, all_ok, rows_record
from benchmarks.verification.everything import verify_paper
from benchmarks.verification.fly_recording import at_times, make_motion
from benchmarks.verification.nesc import _flown, find_files, verify_nesc
from benchmarks.verification.nesc_f16 import RATE, fly_aircraft

ROUND = {"a": 20_902_255.199 * FT, "f": 0.0, "gm": 1.407644311e16 * FT**3, "j2": 0.0}
TUMBLING = (10.0, 20.0, 30.0)
SYNTHETIC = {
    "04": ("RoundStill", {"world": World(**ROUND, omega=0.0), "rates_dps": TUMBLING}),
    "05": ("RoundRotating", {"world": World(**ROUND), "rates_dps": TUMBLING}),
    "07": ("SteadyWind", {"wind": lambda h: 20.0}),
    "08": ("WindShear", {"wind": lambda h: -20.0 + 0.003 * h}),
    "10": (
        "Northward",
        {
            "altitude": 0.0,
            "velocity_ned": (1000.0, 0.0, -1000.0),
            "rates_dps": (0.004178073, 0.0, 0.0),
        },
    ),
}


@cache
def flown(case):
    return np.array(fly_sphere(**{"world": World()} | SYNTHETIC[case][1]))


@pytest.fixture(scope="module")
def given(repository):
    return repository / "tests" / "reference" / "nesc"


@pytest.fixture(scope="module")
def rows(given):
    return verify_nesc(given)


def test_every_published_simulator_is_met(rows):
    bodies = {
        (f"nesc {case}", f"sim {sim}")
        for case in ("01", "02", "03", "06", "09")
        for sim in ("04", "06")
    }
    aircraft = {
        (f"nesc {case}", f"sim {sim}")
        for case in ("11", "12", "13.1", "13.2")
        for sim in ("04", "05")
    }
    assert {(row.case, row.simulator) for row in rows} == bodies | aircraft
    assert [row for row in rows if not row.ok] == []
    assert len(rows) == 60 + 48


def test_the_f16_is_simulator_5(rows):
    """Compare trims and autopilot steps: far within the differences of simulators 04 and 05."""
    worst = {(row.case, row.quantity): row.difference for row in rows if row.simulator == "sim 05"}
    for case, altitude in (("11", 0.002), ("12", 0.004), ("13.1", 0.15), ("13.2", 0.01)):
        assert worst[f"nesc {case}", "altitude"] < altitude  # ft
        assert worst[f"nesc {case}", "latitude"] < 1e-6


def test_without_air_it_is_simulator_4_to_its_printed_digits(rows):
    worst = {(row.case, row.quantity): row.difference for row in rows if row.simulator == "sim 04"}
    for case in ("nesc 01", "nesc 02"):
        assert worst[case, "altitude"] < 1e-6  # ft; twelve digits are printed
        assert worst[case, "velocity"] < 1e-6
        assert worst[case, "longitude"] < 1e-11
        assert worst[case, "euler_angles"] < 1e-8
        assert worst[case, "body_rates"] < 1e-9


@pytest.mark.parametrize("case", SYNTHETIC)
def test_the_other_cases(case, tmp_path):
    write_case(tmp_path, case, SYNTHETIC[case][0], "99", flown(case).tolist())
    rows = verify_nesc(tmp_path)
    assert [row for row in rows if not row.ok] == []
    assert {row.quantity for row in rows} == {
        *("altitude", "velocity", "longitude", "latitude", "euler_angles", "body_rates")
    }


def test_the_wrong_case_is_outside(tmp_path, given):
    # Case 6 under the name of case 7: no wind where 20 ft/s is wanted.
    (tmp_path / "Atmos_07_SteadyWind").mkdir()
    published = given / "Atmos_06_DroppedSphereEllipsoidalNoWind" / "Atmos_06_sim_04.csv.gz"
    with (
        gzip.open(published) as source,
        (tmp_path / "Atmos_07_SteadyWind" / "Atmos_07_sim_04.csv").open("wb") as copy,
    ):
        shutil.copyfileobj(source, copy)
    outside = {row.quantity for row in verify_nesc(tmp_path) if not row.ok}
    assert {"velocity", "longitude"} <= outside
    assert not all_ok(verify_nesc(tmp_path))


def test_other_files_are_left_alone(tmp_path, given):
    shutil.copytree(given / "Atmos_01_DroppedSphere", tmp_path / "deep" / "Atmos_01_DroppedSphere")
    (tmp_path / "Atmos_17_sim_02.csv").write_text("not a case of ours\n")
    assert list(find_files(tmp_path)) == [("01", "04"), ("01", "06")]


# Of altitude (ft), velocity (ft/s), longitude, latitude, Euler angles (deg) and body rates (deg/s).
# The program's law acts 500 times a second, the other one without delay: stops of its stiff roll
# loop come up to 2 ms later.
@pytest.mark.parametrize(
    ("case", "gain", "duration"),
    [
        ("13p3", (15.0, 0.0), 60.0),  # 15 deg to the right
        ("13p4", (0.0, 2000.0), 120.0),  # 2000 ft to the right
    ],
)
def test_course_and_track_reach_their_steps(case, gain, duration):
    motion = make_motion(fly_aircraft(case, duration))
    velocity = motion.velocity_ned
    course = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
    across = (velocity[:, 1] - velocity[:, 0]) / np.sqrt(2.0)  # to the right of 45 deg
    assert course[-1] - course[0] == pytest.approx(gain[0], abs=0.1)
    if gain[1]:
        assert float(np.sum(across)) / RATE / 0.3048 == pytest.approx(gain[1], abs=5.0)
    assert np.abs(np.degrees(motion.euler[:, 2])).max() < 37.0  # commanded 30
    assert np.ptp(motion.altitude) < 3.0


def write_published(folder, case, name, simulator, times, turn):
    """The program's own flight in a published file's columns, angles turned to where they begin."""
    altitude, velocity, longitude, latitude, euler, rates = _flown(
        at_times(1.0 / RATE, fly_aircraft(case, float(times[-1])), times)
    )
    columns = [
        times,
        altitude,
        turn(longitude),
        latitude,
        *velocity.T,
        *turn(euler).T,
        *rates.T,
        0.0 * times,
    ]
    write_case(folder, case, name, simulator, np.column_stack(columns).tolist())


@pytest.mark.parametrize(
    ("case", "name", "end"),
    [
        ("13p3", "SubsonicHeadingChangeF16", 17.0),
        ("15", "CircleNorthPole", 20.0),
        pytest.param("16", "CircleEquatorDateLine", 56.0, marks=pytest.mark.thorough),
    ],
)
def test_files_named_as_the_publishers_are_found_and_compared(tmp_path, case, name, end):
    """Compare at the data's own times.

    Angles may wrap elsewhere: a difference of 360 deg counts as none.
    """
    write_published(
        tmp_path, case, name, "04", np.arange(0.0, end, 0.1), lambda a: (a + 180.0) % 360.0 - 180.0
    )
    write_published(
        tmp_path, case, name, "05", np.arange(0.0, end, 1.0 / 30.0), lambda a: a % 360.0
    )
    rows = verify_nesc(tmp_path)
    title = f"nesc {case.replace('p', '.')}"
    assert {(row.case, row.simulator) for row in rows} == {(title, "sim 04"), (title, "sim 05")}
    assert len(rows) == 12
    assert max(row.difference for row in rows) < 1e-9


def test_one_simulator_alone_is_compared_and_not_judged(tmp_path, given):
    folder = given / "Atmos_11_TrimCheckSubsonicF16"
    (tmp_path / "case").mkdir()
    with gzip.open(next(folder.glob("*sim_04*")), "rt") as file:
        first = [line for line, _ in zip(file, range(50), strict=False)]
    (tmp_path / "case" / "Atmos_11_sim_04.csv").write_text("".join(first))
    rows = verify_nesc(tmp_path)
    assert len(rows) == 6 and not any(row.judged for row in rows)
    assert all(row.difference < 0.1 for row in rows)
    assert {row["tolerance"] for row in rows_record(rows)["rows"]} == {None}


def test_the_papers_numbers():
    scaled = verify_paper(1e-4)
    assert not any(row.ok for row in scaled)
    check([replace(row, tolerance=1e4 * row.tolerance) for row in scaled])


def test_a_row_that_is_no_number_is_not_ok():
    good, bad = Row("a", "b", "c", "m", 1.0, 1.0), Row("a", "b", "d", "m", float("nan"), 1.0)
    assert good.ok and not bad.ok and not all_ok([])
    record = json_data(rows_record([good, bad]))
    assert record["ok"] is False and record["rows"][1]["difference"] is None


def run(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_verify_writes_the_rows_of_a_check_case(repository, tmp_path):
    case = "Atmos_09_EastwardCannonball"
    shutil.copytree(repository / "tests/reference/nesc" / case, tmp_path / case)
    result = run("nesc", tmp_path, "--json", tmp_path / "new/rows.json")
    assert result.exit_code == 0 and ": 0 of 12" in result.stdout
    written = json.loads((tmp_path / "new/rows.json").read_text())
    assert written["ok"] is True
    fields = ["case", "simulator", "quantity", "unit", "difference", "tolerance", "ok"]
    assert [list(row) for row in written["rows"]] == [fields] * 12
    assert {row["case"] for row in written["rows"]} == {"nesc 09"}


def test_a_tolerance_that_is_missed_exits_1(repository, tmp_path):
    file = repository / "tests/reference/cadac-ghame6" / "sturn50_total_h1e-4.csv.gz"
    result = run("ghame6", file, "--tolerance-scale", "0.01", "--json", tmp_path / "rows.json")
    assert result.exit_code == 1 and "OUTSIDE" in result.stdout
    written = json.loads((tmp_path / "rows.json").read_text())
    assert written["ok"] is False and written["rows"][0]["tolerance"] == pytest.approx(0.0009)
