"""The F-16's cases whose published files are not here: the ends of their steps, and files in their form."""

import gzip

import numpy as np
import pytest
from verification.independent import write_case

from abhv_mc.verification.check_rows import rows_record
from abhv_mc.verification.fly_recording import at_times, make_motion
from abhv_mc.verification.nesc import _flown, verify_nesc
from abhv_mc.verification.nesc_f16 import RATE, fly_aircraft


# Of altitude (ft), velocity (ft/s), longitude, latitude, Euler angles (deg) and body rates (deg/s). The program's law
# acts 500 times a second, the other one without delay: stops of its stiff roll loop come up to 2 ms later.
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


def write_published(folder, case: str, name: str, simulator: str, times, turn) -> None:
    """The program's own flight in a published file's columns, angles turned to where they begin."""
    altitude, velocity, longitude, latitude, euler, rates = _flown(
        at_times(1.0 / RATE, fly_aircraft(case, float(times[-1])), times)
    )
    columns = [times, altitude, turn(longitude), latitude, *velocity.T, *turn(euler).T, *rates.T, 0.0 * times]
    write_case(folder, case, name, simulator, np.column_stack(columns).tolist())


@pytest.mark.parametrize(
    ("case", "name", "end"),
    [
        ("13p3", "SubsonicHeadingChangeF16", 17.0),
        ("15", "CircleNorthPole", 20.0),
        pytest.param("16", "CircleEquatorDateLine", 56.0, marks=pytest.mark.thorough),
    ],
)
def test_files_named_as_the_publishers_are_found_and_compared(tmp_path, case, name, end) -> None:
    """At times of their own, and with angles that go round otherwise: a difference of 360 deg is none."""
    write_published(tmp_path, case, name, "04", np.arange(0.0, end, 0.1), lambda a: (a + 180.0) % 360.0 - 180.0)
    write_published(tmp_path, case, name, "05", np.arange(0.0, end, 1.0 / 30.0), lambda a: a % 360.0)
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
