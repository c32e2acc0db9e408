"""The F-16's cases whose published files are not here: by a second integration, and by files in their form."""

import csv
import gzip

import numpy as np
import pytest
from verification.independent_f16 import CASES, F16

from abhv_mc.verification.check_rows import rows_record
from abhv_mc.verification.fly_recording import at_times, make_motion
from abhv_mc.verification.nesc import _differences, _flown, verify_nesc
from abhv_mc.verification.nesc_f16 import RATE, fly_aircraft

# Of altitude (ft), velocity (ft/s), longitude, latitude, Euler angles (deg) and body rates (deg/s). The program's law
# acts 500 times a second, the other one without delay: stops of its stiff roll loop come up to 2 ms later.
STEEP = 0.2, 0.3, 2e-6, 2e-6, 0.5, 10.0
CIRCLE = 2e-3, 5e-3, 5e-5, 1e-7, 5e-3, 0.1


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("case", "duration", "step", "allowed"),
    [("13p3", 20.0, 0.01, STEEP), ("13p4", 25.0, 0.01, STEEP), ("15", 20.0, 0.02, CIRCLE), ("16", 56.0, 0.02, CIRCLE)],
)
def test_a_cartesian_integration_of_the_daveml_graphs_flies_the_same(case, duration, step, allowed) -> None:
    """15 about the pole, 16 across equator and date line, 13.3 and 13.4 into their turns."""
    rows = np.array(F16(**CASES[case]).fly(duration, step, round(0.1 / step)))
    expected = [rows[:, 1], rows[:, 4:7], rows[:, 2], rows[:, 3], rows[:, 7:10], rows[:, 10:13]]
    found = _flown(fly_aircraft(case, duration)[:: round(0.1 * RATE)])
    apart = [float(np.abs(difference).max()) for difference in _differences(found, expected)]
    assert all(difference < most for difference, most in zip(apart, allowed, strict=True)), apart


@pytest.mark.parametrize(
    ("case", "gain", "at"),
    [("13p3", (15.0, 0.0), 60.0), ("13p4", (0.0, 2000.0), 120.0)],
    ids=["15 deg to the right", "2000 ft to the right"],
)
def test_course_and_track_reach_their_steps(case, gain, at) -> None:
    motion = make_motion(fly_aircraft(case, at))
    velocity = motion.velocity_ned
    course = np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0]))
    across = (velocity[:, 1] - velocity[:, 0]) / np.sqrt(2.0)  # to the right of 45 deg
    assert course[-1] - course[0] == pytest.approx(gain[0], abs=0.1)
    if gain[1]:
        assert float(np.sum(across)) / RATE / 0.3048 == pytest.approx(gain[1], abs=5.0)
    assert np.abs(np.degrees(motion.euler[:, 2])).max() < 37.0  # commanded 30
    assert np.ptp(motion.altitude) < 3.0


def write_published(folder, case: str, name: str, simulator: str, times, header, round_the_other_way: bool) -> None:
    """The program's own flight in a published file's columns, angles from 0 to 360 deg or from -180 to 180."""
    altitude, velocity, longitude, latitude, euler, rates = _flown(
        at_times(1.0 / RATE, fly_aircraft(case, float(times[-1])), times)
    )
    turn = (lambda a: a % 360.0) if round_the_other_way else (lambda a: (a + 180.0) % 360.0 - 180.0)
    columns = {"time": times, "altitudeMsl_ft": altitude, "longitude_deg": turn(longitude), "latitude_deg": latitude}
    columns |= {f"feVelocity_ft_s_{axis}": velocity[:, i] for i, axis in enumerate("XYZ")}
    columns |= {f"eulerAngle_deg_{name}": turn(euler[:, i]) for i, name in enumerate(("Yaw", "Pitch", "Roll"))}
    columns |= {f"bodyAngularRateWrtEi_deg_s_{name}": rates[:, i] for i, name in enumerate(("Roll", "Pitch", "Yaw"))}
    path = folder / f"Atmos_{case}_{name}" / f"Atmos_{case}_sim_{simulator}.csv"
    path.parent.mkdir(exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(zip(*(columns.get(name, np.zeros(times.size)) for name in header), strict=True))


@pytest.mark.parametrize(
    ("case", "name", "end"),
    [
        ("13p3", "SubsonicHeadingChangeF16", 17.0),
        pytest.param("13p4", "SubsonicLateralSideStepF16", 22.0, marks=pytest.mark.thorough),
        ("15", "CircleNorthPole", 20.0),
        pytest.param("16", "CircleEquatorDateLine", 56.0, marks=pytest.mark.thorough),
    ],
)
def test_files_named_as_the_publishers_are_found_and_compared(tmp_path, repository, case, name, end) -> None:
    """At times of their own, and with angles that go round otherwise: a difference of 360 deg is none."""
    folder = repository / "tests" / "reference" / "nesc" / "Atmos_13p1_SubsonicAltitudeChangeF16"
    with gzip.open(next(folder.glob("*sim_04*")), "rt") as file:
        header = file.readline().strip().split(",")
    write_published(tmp_path, case, name, "04", np.arange(0.0, end, 0.1), header, False)
    write_published(tmp_path, case, name, "05", np.arange(0.0, end, 1.0 / 30.0), header, True)
    rows = verify_nesc(tmp_path)
    title = f"nesc {case.replace('p', '.')}"
    assert {(row.case, row.simulator) for row in rows} == {(title, "sim 04"), (title, "sim 05")}
    assert len(rows) == 12
    assert max(row.difference for row in rows) < 1e-9


def test_one_simulator_alone_is_compared_and_not_judged(tmp_path, repository) -> None:
    folder = repository / "tests" / "reference" / "nesc" / "Atmos_11_TrimCheckSubsonicF16"
    (tmp_path / "case").mkdir()
    with gzip.open(next(folder.glob("*sim_04*")), "rt") as file:
        first = [line for line, _ in zip(file, range(50), strict=False)]
    (tmp_path / "case" / "Atmos_11_sim_04.csv").write_text("".join(first))
    rows = verify_nesc(tmp_path)
    assert len(rows) == 6 and not any(row.judged for row in rows)
    assert all(row.difference < 0.1 for row in rows)
    assert {row["tolerance"] for row in rows_record(rows)["rows"]} == {None}
