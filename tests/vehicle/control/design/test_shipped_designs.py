"""Shipped designs: stability margins, control effort and tracking, also on the second vehicle."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from short_flights import rows_of

from abhv_mc.flights.outcomes import Outcome
from abhv_mc.shipped import find_input
from abhv_mc_vehicle.control.controller_file import read_controller
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.flight.fly import fly, nominal_parameters
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan
from abhv_mc_vehicle.stability.analysis import margins_of_flights
from abhv_mc_vehicle.stability.steady import make_steady_plan
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[4] / "configs"
BOX = {
    "atmosphere.density": (0.9, 1.1),
    "aero.lift": (0.9, 1.1),
    "aero.drag": (0.85, 1.15),
}  # the paper's
PARAMETERS = rows_of(
    {}, *(dict(zip(BOX, corner, strict=True)) for corner in product(*BOX.values()))
)
USAGE = [
    f"{surface}_{kind}_deg"
    for surface in ("aileron", "elevator", "rudder")
    for kind in ("rms", "travel")
]


@pytest.fixture(scope="module")
def setup():
    return load_vehicle(CONFIGS / "vehicle/ghame_x.yaml"), read_mission(
        CONFIGS / "mission/s_manoeuvre.yaml"
    )


def _read(name):
    return read_controller(find_input(name, "control"))


@pytest.mark.parametrize("name", ["tlc_robust_ghame_x", "lqr_robust_ghame_x"])
def test_margins_hold_nominally_and_at_the_corners_of_the_papers_box(setup, name):
    plan = make_steady_plan(*setup, _read(name), name)
    least = margins_of_flights(plan, plan, PARAMETERS, ["trim"]).table[:, :3]
    assert (least[0] >= (6.0, 35.0, 40.0)).all()
    assert (least[1:] >= (4.5, 30.0, 30.0)).all()


@pytest.mark.parametrize("name", ["tlc_robust_ghame_x", "lqr_robust_ghame_x"])
def test_designs_tolerate_effectiveness_errors_and_delay_without_more_control_effort(setup, name):
    """Simulate with 1.2 times the rudder effectiveness.

    Table 1 then has a limit cycle, and these designs have none.
    """
    factors = {"rudder": (1.2, 0.8), "aileron": (0.8,), "elevator": (0.8,)}
    cases = [
        {f"control.{surface}_effectiveness": x}
        for surface, values in factors.items()
        for x in values
    ]
    parameters = rows_of({}, *cases, {"sensor.delay": 0.04})
    block = fly(make_plan(*setup, _read(name), name), parameters)
    table_1 = fly(make_plan(*setup, _read("tlc"), "tlc"), parameters[:2])
    settled = METRIC_INDEX["bank_error_settled_max_deg"]
    assert (block.outcome == Outcome.OK).all()
    assert (block.metrics[:, settled] < block.metrics[0, settled] + 0.5).all()
    assert table_1.metrics[1, settled] > table_1.metrics[0, settled] + 5.0
    usage = [METRIC_INDEX[key] for key in USAGE]
    assert (block.metrics[0, usage] <= 1.05 * table_1.metrics[0, usage]).all()


@pytest.mark.parametrize(
    ("vehicle", "retuned"),
    [
        ("ghame_x", "lqr_retuned_ghame_x"),
        ("ghame_x_coupled", "lqr_retuned_ghame_x_coupled"),
        ("ghame", "lqr_retuned_ghame"),
    ],
)
def test_retuned_lqr_tracks_better_than_the_papers_weights_at_the_effort_of_tlc(vehicle, retuned):
    """Nominal flight of the S manoeuvre."""
    metrics = {}
    for name, file in {"tlc": "tlc", "lqr": "lqr", "retuned": retuned}.items():
        block = fly(make_flight_plan("s_manoeuvre", vehicle, file), nominal_parameters())
        assert block.outcome[0] == Outcome.OK
        metrics[name] = {metric: block.metrics[0, i] for metric, i in METRIC_INDEX.items()}
    for name in USAGE:
        assert metrics["retuned"][name] <= 1.05 * metrics["tlc"][name], name
    assert metrics["retuned"]["sideslip_rms_deg"] < metrics["lqr"]["sideslip_rms_deg"]
    for name in ("speed_error_rms_mps", "angle_of_attack_error_rms_deg"):
        assert metrics["retuned"][name] < 0.5 * metrics["lqr"][name], name


# Worst of the nominal flight and the corners; measured 26 m, 0.6 m/s, 0.04 deg.
WORST = {
    "altitude_error_max_m": 40.0,
    "speed_error_max_mps": 1.0,
    "angle_of_attack_error_rms_deg": 0.1,
    "sideslip_max_deg": 0.02,
    "surface_saturation_s": 1e-9,
    "outside_tables_s": 1e-9,
}


@pytest.mark.parametrize("mission", ["level", "turn", "level_mach15", "turn_mach15"])
def test_table_1_flies_the_winged_cone_at_both_points(mission):
    """Simulate the winged cone.

    It has elevons, three-dimensional tables and a centre of gravity aft of the moment
    reference.
    """
    plan = make_flight_plan(mission, "winged_cone")
    block = fly(plan, PARAMETERS)
    assert np.array_equal(
        fly(plan, PARAMETERS[7:]).metrics, block.metrics[7:]
    )  # 3-D cells shared or not
    assert (block.outcome == Outcome.OK).all()
    for name, most in WORST.items():
        assert block.metrics[:, METRIC_INDEX[name]].max() < most, name
    assert block.metrics[0, METRIC_INDEX["altitude_error_max_m"]] < 10.0
    assert block.metrics[0, METRIC_INDEX["speed_error_max_mps"]] < 0.05
