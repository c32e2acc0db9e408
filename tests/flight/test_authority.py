"""Vehicles that no controller can fly are refused with their file, before anything flies."""

import pytest

from abhv_mc.io.documents import InputError
from abhv_mc.one_flight.given import make_flight_plan

NOTHING = {"constant": 0, "unit": "1/deg"}


@pytest.mark.parametrize(
    ("base", "tables", "file", "words"),
    [
        ("nesc/sphere", {}, "vehicle/nesc/sphere", "without control surfaces or engine"),
        (
            "ghame_x",
            {"roll_rudder": NOTHING, "yaw_rudder": NOTHING},
            "vehicle/ghame_x",
            "do not turn the vehicle about three axes",
        ),
        (
            "ghame_x",
            {"capture_area_ratio": {"constant": 0}},
            "mission/level",
            "no throttle within the engine's limits",
        ),
    ],
    ids=["no surfaces", "a rudder that does nothing", "no thrust"],
)
def test_a_vehicle_that_cannot_be_flown_is_refused(repository, base, tables, file, words):
    configs = repository / "configs"
    changed = {f"tables.{name}": table for name, table in tables.items()}
    with pytest.raises(InputError, match=words) as caught:
        make_flight_plan("level", {"base": configs / f"vehicle/{base}.yaml", **changed})
    assert caught.value.file == str(configs / f"{file}.yaml")
