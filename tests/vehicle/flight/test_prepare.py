"""Tests of accepted missions, vehicles and controllers, and of errors and warnings."""

import re

import numpy as np
import pytest

import abhv_mc
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.flight.channels import CHANNELS
from abhv_mc_vehicle.flight.prepare import table_faults
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.one_flight.fly_once import make_flight_plan

GLIDER = {"base": "ghame_x", "propulsion": None}
NOTHING = {"constant": 0, "unit": "1/deg"}
VEHICLE = "vehicle/ghame_x"


@pytest.mark.parametrize(
    ("change", "pattern"),
    [
        ({}, ""),  # the paper's
        ({"start.altitude": "29 km"}, r"\b6001 .* 0\.00 s\b"),  # beyond the vehicle
        (
            {"start.altitude": "20 km"},
            r"-76\.6 deg\b.* 0\.00 s\b",
        ),  # beyond the controller's limit
    ],
)
def test_missing_trim_and_exceeded_command_limits_are_warned_of_with_their_time(change, pattern):
    wide = (
        {"manoeuvre": {"kind": "s_manoeuvre", "offset": "20 km", "length": "50 s"}}
        if change
        else {}
    )
    warnings = make_flight_plan(
        {"base": "s_manoeuvre", **change, **wide}, "ghame_x"
    ).warnings.tolist()
    assert any(re.search(pattern, warning) for warning in warnings) if pattern else not warnings


def test_a_reference_outside_the_tables_for_a_second_causes_a_warning():
    """The limits of abhv begin at Mach 4, and 1150 m/s at 20 km are Mach 3.9."""
    slow = {"base": "level", "start.speed": "1150 m/s"}
    plan = make_flight_plan(slow, "abhv")
    (warning,) = plan.warnings.tolist()
    assert re.search(r"\bmach\b.* 60\.0 s\b.* 0\.00 s\b", warning)
    fast = plan.reference.copy()
    fast[:, REFERENCE.index("speed")] *= 1.1
    for ticks, count in ((99, 0), (100, 1)):
        fast[1000 : 1000 + ticks] = plan.reference[1000 : 1000 + ticks]
        faults = table_faults(plan.vehicle, fast, plan.timing.tick)
        assert len(faults) == count
    assert re.search(r" 1\.0 s\b.* 10\.00 s\b", faults[0])


@pytest.mark.parametrize(
    ("vehicle", "mission", "file", "pattern"),
    [
        ({"base": "nesc/sphere"}, {}, "vehicle/nesc/sphere", "surfaces"),
        (
            {"tables.roll_rudder": NOTHING, "tables.yaw_rudder": NOTHING},
            {},
            VEHICLE,
            r"\baileron\b.*\brudder\b.*\belevator\b",
        ),
        (
            {"tables.capture_area_ratio": {"constant": 0}},
            {},
            "mission/level",
            "throttle",
        ),
        ({}, {"start.altitude": "39 km"}, "mission/level", r"\b\d+ of \d+ "),
        (GLIDER, {}, VEHICLE, "engine"),
        ({}, {"start.latitude": "-89.995 deg"}, "mission/level", r"89\.995"),
        (
            {"propulsion.engines": {"left": {"y": "-1 m"}, "right": {"y": "2 m"}}},
            {},
            VEHICLE,
            "engines",
        ),
        ({"propulsion.engines": {"left": {"share": 0.4}, "right": {}}}, {}, VEHICLE, "shares"),
    ],
    ids=lambda case: case if isinstance(case, str) else None,
)
def test_impossible_missions_and_vehicles_are_rejected(repository, vehicle, mission, file, pattern):
    vehicle = {
        **vehicle,
        "base": repository / f"configs/vehicle/{vehicle.get('base', 'ghame_x')}.yaml",
    }
    with pytest.raises(InputError, match=pattern) as caught:
        make_flight_plan({"base": repository / "configs/mission/level.yaml", **mission}, vehicle)
    assert caught.value.file == str(repository / f"configs/{file}.yaml")


def test_a_glide_balances_weight_lift_and_drag():
    table = abhv_mc.trim(GLIDER, "32 km", bank=["0 deg", "30 deg"])
    assert (
        table["trimmed"].all()
        and (table["equivalence_ratio"] == 0.0).all()
        and (table["thrust_n"] == 0.0).all()
    )
    straight = table.iloc[0]
    # On a round Earth at rest V^2 / r carries part of the weight.
    lift, drag = straight["lift_n"], straight["drag_n"]
    carried = 1.0 - 1400.0**2 / (9.75 * 6.39e6)
    assert np.tan(np.deg2rad(-straight["flight_path_angle_deg"])) == pytest.approx(
        drag / lift * carried, rel=0.01
    )
    assert table["flight_path_angle_deg"].iloc[1] < straight["flight_path_angle_deg"]


def test_a_custom_law_flies_a_glider():
    mission = {
        "base": "level",
        "duration": "8 s",
        "start.altitude": "32 km",
    }  # then the air is denser
    flown = abhv_mc.fly(mission, GLIDER, "cascade", every=100)
    assert flown.attrs["outcome"] == "ok"
    angle = abhv_mc.trim(GLIDER, "32 km")["flight_path_angle_deg"].iloc[0]
    assert flown["flight_path_angle_deg"].iloc[0] == pytest.approx(angle, abs=1e-3)
    np.testing.assert_allclose(flown["flight_path_angle_deg"], angle, atol=0.5)
    np.testing.assert_allclose(flown["speed_mps"], 1400.0, atol=15.0)
    assert (flown["thrust_n"] == 0.0).all() and flown["mass_kg"].nunique() == 1


def test_a_glider_without_equilibrium_slows_down():
    """At 20 km the drag is above the weight."""
    angle = next(item.doc for item in CHANNELS if item.name == "flight_path_angle_deg")
    assert angle in abhv_mc.trim(GLIDER)["fault"].iloc[0]
    flown = abhv_mc.fly({"base": "level", "duration": "2 s"}, GLIDER, "cascade", every=100)
    assert flown["flight_path_angle_deg"].iloc[0] == pytest.approx(0.0, abs=1e-6)
    assert flown["speed_mps"].iloc[-1] < 1375.0
    assert any(angle in warning for warning in flown.attrs["warnings"])
