"""Tests of linear models and margins of effectors with different actuators.

Control laws command axes or effectors.
"""

import numpy as np
import pytest
from short_flights import cut, rows_of
from vehicle.flight.test_effectors_apart import FUNCTIONS, LAW, VEHICLE
from vehicle.stability.systems import assert_neutral, assert_predicted

from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.prepare import prepare, read_law
from abhv_mc_vehicle.stability.analysis import analyse, cut_loops, make_rows, margin_values
from abhv_mc_vehicle.stability.linearize import linearize
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.steady import make_steady_plan, trim_points
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

MISSION = shipped_configs() / "mission" / "level.yaml"
LEVEL = LAW.replace("bank - 0.2", "bank + 0.8 * (measured.heading - reference.heading)")
AXES = LEVEL[: LEVEL.index("    return Command(")] + (
    "    return Command(aileron, 0.5 * measured.yaw_rate + 0.3 * measured.sideslip, elevator, "
    "throttle=throttle)\n"
)
EFFECTORS = ("left", "right", "flap", "rudder")


@pytest.fixture
def write(tmp_path):
    """The three files, with a law."""

    def written(law):
        for name, text in (("plank.yaml", VEHICLE), ("plank.py", FUNCTIONS), ("own.py", law)):
            (tmp_path / name).write_text(text, encoding="utf-8")
        (tmp_path / "own.yaml").write_text(
            "law: python\nfile: own.py\nrate: 100 Hz\n", encoding="utf-8"
        )
        return tmp_path / "plank.yaml", MISSION, tmp_path / "own.yaml"

    return written


@pytest.mark.parametrize("law", [LEVEL, AXES], ids=["effectors", "axes"])
def test_the_closed_loop_is_that_of_full_flights(write, law):
    assert_predicted(
        cut(prepare(*write(law), "own"), 200), rows_of({"actuator.bandwidth": 0.9}), 100, 40, 10
    )


def trimmed(files, **case):
    law, code = read_law(files[2])
    plan = make_steady_plan(
        load_vehicle(files[0]), read_mission(files[1]), law, "own", user_code=code
    )
    trims = trim_points(plan, rows_of({name.replace("__", "."): x for name, x in case.items()}))
    assert trims.faults == [""]
    return linearize(plan, trims.points), trims.points


def test_a_law_of_axes_counts_their_loops_and_shows_those_of_effectors(write):
    linear, points = trimmed(write(AXES))
    stability = analyse(linear, 400, apart=True)
    assert stability.stable[0] and linear.apart is not None
    assert_neutral(linear, stability.margins)
    assert_neutral(linear.apart, stability.apart.margins)
    named = (
        "aileron",
        "rudder",
        "elevator",
        "equivalence_ratio",
        "left",
        "right",
        "flap",
        "rudder_effector",
        "all",
    )
    assert tuple(margin_values(stability)) == named
    rows = make_rows("own", None, stability)
    assert [row["loop"] for row in rows if not row.get("counts", True)] == [
        "left",
        "right",
        "flap",
        "rudder_effector",
    ]
    np.testing.assert_allclose(
        np.sort(stability.poles[0]), np.sort(stability.apart.poles[0]), atol=1e-6
    )
    assert points.controls[0, 2] == pytest.approx(
        0.25 * points.controls[0, :2].sum(), abs=1e-9
    )  # the mix


def test_a_law_of_effectors_counts_theirs_and_rests_where_it_puts_them(write):
    linear, points = trimmed(write(LEVEL))
    stability = analyse(linear, 400, apart=True)
    assert stability.inputs == (*EFFECTORS, "equivalence_ratio") and stability.apart is None
    assert stability.stable[0]
    assert_neutral(linear, stability.margins)
    flap = 0.02 - 0.4 * points.path[0, 8]  # where no mix would put it
    assert points.controls[0, 2] == pytest.approx(flap, abs=1e-8)


def test_a_stuck_effector_has_no_loop(write):
    files = write(AXES)
    plan = cut(prepare(*files, "own"), 200)
    rows = rows_of({"failure.effector_2.stuck_time": 0.5, "failure.effector_2.stuck_at": 0.03})
    points = flown_points(plan, rows, 1.5).points
    assert points.controls[0, 2] == pytest.approx(0.03, abs=1e-6)
    stability = analyse(linearize(plan, points), apart=True)
    assert cut_loops(stability) == {"flap": "stuck"}
    _, points = trimmed(
        files, failure__effector_2__stuck_time=0.0, failure__effector_2__stuck_at=0.03
    )
    assert points.controls[0, 2] == pytest.approx(0.03, abs=1e-12)
