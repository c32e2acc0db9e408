"""Vehicles that no controller can fly are refused with their file, before anything flies."""

import pytest
from short_flights import change_vehicle

from abhv_mc.flight.prepare import prepare
from abhv_mc.io.documents import InputError


@pytest.fixture
def configs(repository):
    return repository / "configs"


def test_a_vehicle_without_surfaces_has_no_controller(configs):
    sphere = configs / "vehicle/nesc/sphere.yaml"
    with pytest.raises(InputError, match="without control surfaces or engine") as caught:
        prepare(sphere, configs / "mission/level.yaml", configs / "control/tlc.yaml", "tlc")
    assert caught.value.file == str(sphere)


def test_a_rudder_that_does_nothing_cannot_be_allocated(configs, tmp_path):
    changes = [(f"{name}_rudder: {{file: ghame/{file}.csv,", f"{name}_rudder: {{constant: 0,")
               for name, file in (("roll", "clldr"), ("yaw", "clndr"))]  # fmt: skip
    path = change_vehicle(tmp_path, *changes)
    with pytest.raises(InputError, match="do not turn the vehicle about three axes") as caught:
        prepare(path, configs / "mission/level.yaml", configs / "control/tlc.yaml", "tlc")
    assert caught.value.file == str(path)


def test_a_glider_cannot_hold_its_speed(configs, tmp_path):
    path = change_vehicle(tmp_path, ("capture_area_ratio: {file: ghame/ca.csv}", "capture_area_ratio: {constant: 0}"))
    with pytest.raises(InputError, match="no equivalence ratio within the engine's limits holds the speed"):
        prepare(path, configs / "mission/level.yaml", configs / "control/tlc.yaml", "tlc")
