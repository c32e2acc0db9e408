"""A plan says where its mission cannot be flown, and there is none for a mission that cannot be flown at all."""

import pytest

from abhv_mc.io.documents import InputError
from abhv_mc.one_flight.given import make_flight_plan


def test_the_papers_mission_needs_no_warning() -> None:
    assert make_flight_plan("s_manoeuvre", "ghame_x").warnings.tolist() == []


def warnings_of_a_wide_s(altitude: str) -> list[str]:
    wide = {"kind": "s_manoeuvre", "offset": "20 km", "length": "50 s"}
    return make_flight_plan(
        {"base": "s_manoeuvre", "start.altitude": altitude, "manoeuvre": wide}, "ghame_x"
    ).warnings.tolist()


def test_a_turn_beyond_the_vehicle_is_told_with_its_time() -> None:
    warnings = warnings_of_a_wide_s("29 km")
    assert any("no angle of attack" in words and "of 6001 points, first at 0.00 s" in words for words in warnings)


def test_a_turn_beyond_the_controllers_limit_is_told() -> None:
    expected = "the mission takes -76.6 deg of bank, which the controller limits, at 0.00 s"
    assert warnings_of_a_wide_s("20 km") == [expected]


def test_a_mission_that_cannot_be_flown_at_all_is_refused() -> None:
    with pytest.raises(InputError, match=r"level\.yaml: no .* at 1?\d+ of \d+ points"):
        make_flight_plan({"base": "level", "start.altitude": "39 km"}, "ghame_x")
