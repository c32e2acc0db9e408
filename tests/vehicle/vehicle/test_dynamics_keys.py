"""Custom dynamics in a vehicle file: errors with their location, and conversion to SI."""

import re

import pytest
from short_flights import change_vehicle

from abhv_mc.io.messages import InputError
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.flight.channels import state_channels
from abhv_mc_vehicle.vehicle.file import read_vehicle_file
from abhv_mc_vehicle.vehicle.vehicle_code import name_states

LIMIT = "  sideslip: 15 deg\n"
CASES = {
    "unit": ("mode_1: m\n", "mode_1: mx\n", "'mx'"),
    "circle": ("mode_1: m\n", "mode_1: {unit: m, circular: yes}\n", "'m' of a circular"),
    "start": ("mode_1: m\n", "mode_1: {unit: m, start: 3 kg}\n", "'3 kg'"),
    "word": ("mode_1: m\n", "mode-1: m\n", "'mode-1'"),
    "duplicate": ("mode_1: m\n", "altitude: m\n", "'initial.altitude'"),
    "setting": ("19 rad/s", "19 radd/s", "'radd'"),
    "state of a limit": (LIMIT, f"{LIMIT}  state.mode_9: 5 cm\n", "'mode_3'"),
    "unit of a limit": (LIMIT, f"{LIMIT}  state.mode_1: 5 kg\n", "5 kg"),
    "key of limits": (LIMIT, f"{LIMIT}  sidslip: 5 deg\n", "'sideslip'"),
}


@pytest.mark.parametrize("case", CASES)
def test_errors_give_their_location(tmp_path, case):
    old, new, fragment = CASES[case]
    path = change_vehicle(tmp_path, (old, new), name="flexible")
    with pytest.raises(InputError, match=re.escape(fragment)) as caught:
        read_vehicle_file(path)
    assert re.search(r"vehicle\.yaml:\d+:\d+: ", str(caught.value))


def test_circular_states_are_circular_channels(tmp_path):
    changes = (
        ("mode_1: m\n", "mode_1: {unit: rad, circular: yes}\n"),
        ("mode_2: m\n", "mode_2: rad\n"),
    )
    code = read_vehicle_file(change_vehicle(tmp_path, *changes, name="flexible")).code
    channels = {channel.name: channel for channel in state_channels(name_states(code))}
    assert channels["state.mode_1"].period == pytest.approx(360.0)  # in degrees, as recorded
    assert channels["state.mode_2"].period == channels["state.mode_3"].period == 0.0


def test_settings_and_limits_are_in_si(tmp_path):
    changes = (LIMIT, f"{LIMIT}  state.mode_1: 5 cm\n"), ("0.12 rad/m", "12 rad/km")
    code = read_vehicle_file(change_vehicle(tmp_path, *changes, name="flexible")).code
    assert code.states[0].limit == pytest.approx(0.05)
    values = {setting.name: (setting.value, setting.unit) for setting in code.settings}
    assert values["dynamics.nose_slope"] == (pytest.approx(0.012), "rad/m")
    assert values["dynamics.frequency_1"] == (19.0, "rad/s")
    assert str(shipped_configs()) in code.dynamics.file
