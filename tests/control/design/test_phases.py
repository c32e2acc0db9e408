"""Phases one after another: each begins where the last one ended, and rates belong to their values."""

from pathlib import Path

import numpy as np
import pytest

from abhv_mc.control.design.profile import make_profile, step_times
from abhv_mc.control.mission import Mission, read_mission
from abhv_mc.io.documents import InputError

_START = "{altitude: 20 km, speed: 1400 m/s, heading: 90 deg, latitude: 29.3 deg, flight_path_angle: %s}"
_PHASES = """manoeuvre:
  kind: phases
  phases:
    - {kind: climb, altitude_change: 500 m, length: 20 s, speed_change: 50 m/s}
    - {kind: level, length: 5 s}
    - {kind: turn, heading_change: 6 deg, length: 25 s}
    - {kind: s_manoeuvre, offset: 2 km, length: 30 s}
    - {kind: pull_up, flight_path_angle: 1 deg, length: 10 s}
"""


def _read(tmp_path: Path, phases: str = _PHASES, climb: str = "0 deg") -> Mission:
    path = tmp_path / "mission.yaml"
    path.write_text(f"name: m\nstart: {_START % climb}\nduration: 100 s\nstart_time: 5 s\n{phases}", encoding="utf-8")
    return read_mission(path)


def test_what_a_phase_leaves_is_held(tmp_path: Path) -> None:
    profile = make_profile(_read(tmp_path), np.array([0.0, 25.0, 30.0, 55.0, 85.0]))
    assert profile.altitude == pytest.approx([20e3, 20.5e3, 20.5e3, 20.5e3, 20.5e3])
    assert profile.speed == pytest.approx([1400.0, 1450.0, 1450.0, 1450.0, 1450.0])
    assert np.rad2deg(profile.heading) == pytest.approx([90.0, 90.0, 90.0, 96.0, 96.0])
    assert profile.heading_rate[2:4] == pytest.approx(0.0, abs=0.02)


def test_the_s_goes_sideways_by_its_offset_at_the_speed_that_it_is_flown_with(tmp_path: Path) -> None:
    times = np.linspace(55.0, 85.0, 30001)
    profile = make_profile(_read(tmp_path), times)
    left = np.trapezoid(profile.speed * np.sin(np.deg2rad(96.0) - profile.heading), times)
    assert left == pytest.approx(2000.0, rel=1e-3)
    assert step_times(_read(tmp_path)) == (55.0, 85.0)


@pytest.mark.parametrize("climb", ["0 deg", "-0.5 deg"])
def test_rates_are_those_of_the_values(tmp_path: Path, climb: str) -> None:
    times = np.arange(0.0, 100.0, 0.001)
    profile = make_profile(_read(tmp_path, climb=climb), times)
    calm = np.abs(times - 55.0) > 0.01
    calm &= np.abs(times - 85.0) > 0.01
    for value, rate in (
        (profile.altitude, profile.altitude_rate),
        (profile.speed, profile.speed_rate),
        (profile.heading, profile.heading_rate),
        (profile.flight_path_angle, profile.flight_path_angle_rate),
    ):
        slope = np.gradient(value, times)
        off, size = np.abs(slope - rate)[calm][1:-1], np.abs(rate)[calm][1:-1]
        assert np.all(off <= np.maximum(2e-4, 1e-4 * size))
    assert np.rad2deg(profile.flight_path_angle[[0, -1]]) == pytest.approx([float(climb.split(maxsplit=1)[0]), 1.0])


def test_a_phase_that_leaves_the_limits_is_named(tmp_path: Path) -> None:
    text = _PHASES + "    - {kind: climb, altitude_change: 30 km, length: 10 s}\n"
    with pytest.raises(InputError, match=r"(?s)a climb to 50500 m") as error:
        _read(tmp_path, text)
    assert error.value.line == 13
