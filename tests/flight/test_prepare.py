"""A plan says where its mission cannot be flown, and there is none for a mission that cannot be flown at all."""

from pathlib import Path

import pytest

from abhv_mc.control.controller_file import read_controller
from abhv_mc.control.mission import Mission, SManoeuvre, read_mission
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.flight.prepare import make_plan
from abhv_mc.io.documents import InputError
from abhv_mc.user_code.vehicle_functions import load_vehicle

CONFIGS = Path(__file__).parents[2] / "configs"


def plan_of(mission: Mission) -> FlightPlan:
    vehicle = load_vehicle(CONFIGS / "vehicle" / "ghame_x.yaml")
    return make_plan(vehicle, mission, read_controller(CONFIGS / "control" / "tlc.yaml"), "tlc", "a.yaml")


def test_the_papers_mission_needs_no_warning() -> None:
    assert plan_of(read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")).warnings.tolist() == []


def wide_s(altitude: float) -> Mission:
    mission = read_mission(CONFIGS / "mission" / "s_manoeuvre.yaml")
    s = SManoeuvre(kind="s_manoeuvre", offset="20 km", length="50 s")
    start = mission.start.model_copy(update={"altitude": altitude})
    return mission.model_copy(update={"manoeuvre": s, "start": start})


def test_a_turn_beyond_the_vehicle_is_told_with_its_time() -> None:
    warnings = plan_of(wide_s(29e3)).warnings.tolist()
    assert any("no angle of attack" in words and "of 6001 points, first at 0.00 s" in words for words in warnings)


def test_a_turn_beyond_the_controllers_limit_is_told() -> None:
    assert plan_of(wide_s(20e3)).warnings.tolist() == [
        "the mission takes -76.6 deg of bank, which the controller limits, at 0.00 s"
    ]


def test_a_mission_that_cannot_be_flown_at_all_is_refused() -> None:
    mission = read_mission(CONFIGS / "mission" / "level.yaml")
    start = mission.start.model_copy(update={"altitude": 39e3})
    with pytest.raises(InputError, match=r"^a\.yaml: no .* at 1?\d+ of \d+ points"):
        plan_of(mission.model_copy(update={"start": start}))
