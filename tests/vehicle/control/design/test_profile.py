"""Manoeuvres, single or in phases: rates are derivatives, final values are those of the file."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from abhv_mc.io.documents import Document, validate
from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.control.design.profile import make_profile, ramp_times
from abhv_mc_vehicle.control.mission import Mission, read_mission

START = {"altitude": "20 km", "speed": "1400 m/s", "heading": "90 deg", "latitude": "29.3 deg"}
STEP = 0.005
TIMES = np.arange(0.0, 60.0 + STEP / 2.0, STEP)


def make_mission(manoeuvre, **entries):
    data = {"name": "test", "start": START, "manoeuvre": manoeuvre} | entries
    return validate(Document(Path("test.yaml"), data, {(): (1, 1)}, {}), Mission)


def recorded(folder):
    """Write a smooth climbing turn through north as a recorded manoeuvre.

    Its heading wraps.
    """
    t = np.arange(0.0, 61.0, 1.0)
    lines = ["time_s,altitude_m,speed_mps,heading_deg,remark"]
    for s in t:
        heading = (350.0 + 20.0 * np.sin(s / 30.0) ** 2) % 360.0
        lines.append(
            f"{s},{20000 + 300 * np.sin(s / 20.0)},{1400 + 5 * np.cos(s / 15.0)},{heading},x"
        )
    path = folder / "trajectory.csv"
    path.write_text("\n".join(lines) + "\n")
    return {"kind": "recorded", "file": str(path)}


MANOEUVRES = {
    "level": {"kind": "level"},
    "climb": {
        "kind": "climb",
        "altitude_change": "-2 km",
        "length": "40 s",
        "speed_change": "30 m/s",
    },
    "pull_up": {"kind": "pull_up", "flight_path_angle": "6 deg", "length": "10 s"},
    "turn": {"kind": "turn", "heading_change": "10 deg", "length": "45 s"},
    "s_manoeuvre": {"kind": "s_manoeuvre", "offset": "-3 km", "length": "40 s"},
    "waypoints": {
        "kind": "waypoints",
        "turns": [
            {"at": "0 s", "heading_change": "8 deg", "length": "20 s"},
            {"at": "15 s", "heading_change": "-5 deg", "length": "20 s"},
        ],
    },
    "recorded": {"kind": "recorded"},
    "phases": {
        "kind": "phases",
        "phases": [
            {
                "kind": "climb",
                "altitude_change": "200 m",
                "length": "20 s",
                "speed_change": "50 m/s",
            },
            {"kind": "level", "length": "5 s"},
            {"kind": "turn", "heading_change": "4 deg", "length": "10 s"},
            {"kind": "s_manoeuvre", "offset": "500 m", "length": "10 s"},
            {"kind": "pull_up", "flight_path_angle": "1 deg", "length": "5 s"},
        ],
    },
}


@pytest.mark.parametrize("kind", MANOEUVRES)
def test_rates_are_derivatives(kind, tmp_path):
    manoeuvre = recorded(tmp_path) if kind == "recorded" else MANOEUVRES[kind]
    start = START | {"flight_path_angle": "-0.5 deg"} if kind == "phases" else START
    mission = make_mission(
        manoeuvre, start_time="0 s" if kind == "recorded" else "5 s", start=start
    )
    profile = make_profile(mission, TIMES)
    smooth = np.ones(TIMES.size - 2, dtype=bool)
    for ramp in ramp_times(mission):
        for end in ramp if ramp[0] == ramp[1] else ():
            smooth &= np.abs(TIMES[1:-1] - end) > 2.0 * STEP
    pairs = (("altitude", 5.0), ("flight_path_angle", 0.1), ("speed", 0.2), ("heading", 1e-2))
    for name, scale in pairs:
        value, rate = getattr(profile, name), getattr(profile, f"{name}_rate")
        central = (value[2:] - value[:-2]) / (2.0 * STEP)
        np.testing.assert_allclose(
            central[smooth], rate[1:-1][smooth], atol=2e-5 * scale + 1e-9 / STEP
        )
    np.testing.assert_allclose(
        profile.altitude_rate, profile.speed * np.sin(profile.flight_path_angle), atol=1e-9
    )


def test_manoeuvres_end_at_their_final_values():
    at_end = {
        kind: make_profile(make_mission(MANOEUVRES[kind]), TIMES)
        for kind in ("climb", "pull_up", "turn", "waypoints")
    }
    start = np.deg2rad(90.0)
    assert at_end["climb"].altitude[-1] == pytest.approx(18e3)
    assert at_end["climb"].speed[-1] == pytest.approx(1430.0)
    assert at_end["pull_up"].flight_path_angle[-1] == pytest.approx(np.deg2rad(6.0))
    climbed = 1400.0 * np.sin(np.deg2rad(6.0)) * 50.0
    assert at_end["pull_up"].altitude[-1] - at_end["pull_up"].altitude[2000] == pytest.approx(
        climbed
    )
    assert at_end["turn"].heading[-1] - start == pytest.approx(np.deg2rad(10.0))
    assert at_end["waypoints"].heading[-1] - start == pytest.approx(np.deg2rad(3.0))


@pytest.mark.parametrize(
    ("length", "bank_time", "sharpness"),
    [(53.4, 1.8, 1.8), (50.0, 0.0, 2.4), (55.0, 0.7, 1.0), (40.0, 20.0, 1.0)],
)
def test_an_s_with_ramps_by_an_independent_integration(length, bank_time, sharpness):
    """Compare speed and acceleration with scipy's quadrature of the formula; the offset remains."""
    s = {
        "kind": "s_manoeuvre",
        "offset": "-5 km",
        "length": f"{length} s",
        "bank_time": f"{bank_time} s",
    }
    mission = make_mission(s | {"sharpness": sharpness}, start_time="3 s")
    times = np.array(
        [0.0, 3.0, *3.0 + length * np.array([0.01, 0.2, 0.45, 0.5, 0.7, 0.97]), 3.0 + length, 59.9]
    )

    def growth(t):
        """Return the relative acceleration.

        The step of order 5 is the integral of 30 x^2 (1 - x)^2.
        """
        share = 1.0
        for since in (t, length - t):
            x = min(since / bank_time, 1.0) if bank_time else 1.0
            share *= quad(lambda u: 30.0 * u**2 * (1.0 - u) ** 2, 0.0, x)[0]
        c = np.cos(np.pi * t / length)
        return float(np.sign(c) * abs(c) ** sharpness * share)

    def integral(weight, end):
        breaks = [t for t in (bank_time, 0.5 * length, length - bank_time) if 0.0 < t < end]
        return float(
            quad(lambda t: weight(t) * growth(t), 0.0, end, points=breaks or None, limit=200)[0]
        )

    size = 5000.0 / integral(lambda t: length - t, length)
    since = np.clip(times - 3.0, 0.0, length)
    speed = np.array([size * integral(lambda t: 1.0, end) for end in since])
    profile = make_profile(mission, times)
    np.testing.assert_allclose(1400.0 * np.sin(profile.heading - np.pi / 2.0), speed, atol=1e-6)
    inside = (times >= 3.0) & (times < 3.0 + length)
    acceleration = np.array([size * growth(t) for t in since]) * inside
    np.testing.assert_allclose(
        profile.heading_rate * 1400.0 * np.cos(profile.heading - np.pi / 2.0),
        acceleration,
        atol=1e-6,
    )
    assert profile.heading[-2:] == pytest.approx(np.deg2rad(90.0), abs=1e-12)
    assert ramp_times(mission) == ((3.0, 3.0 + bank_time), (3.0 + length - bank_time, 3.0 + length))
    fine = make_profile(mission, TIMES)
    sideways = np.sum(fine.speed * np.sin(fine.heading - np.pi / 2.0)) * STEP
    assert sideways == pytest.approx(5000.0, rel=1e-5)


def test_final_values_of_a_phase_are_kept():
    mission = make_mission(MANOEUVRES["phases"], start_time="5 s")
    profile = make_profile(mission, np.array([0.0, 25.0, 30.0, 40.0, 50.0]))
    assert profile.altitude == pytest.approx([20e3, *4 * [20.2e3]])
    assert profile.speed == pytest.approx([1400.0, *4 * [1450.0]])
    assert np.rad2deg(profile.heading) == pytest.approx([90.0, 90.0, 90.0, 94.0, 94.0])
    assert ramp_times(mission) == ((40.0, 40.0), (50.0, 50.0))
    times = np.linspace(40.0, 50.0, 10001)
    s = make_profile(mission, times)
    left = np.trapezoid(s.speed * np.sin(np.deg2rad(94.0) - s.heading), times)
    assert left == pytest.approx(500.0, rel=1e-3)  # at the speed that it is flown with


@pytest.mark.parametrize(
    ("text", "pattern"),
    [
        ("manoeuvre: {kind: loop}", "'loop'"),
        (
            "manoeuvre: {kind: climb, altitude_change: 30 km, length: 40 s}",
            "50000 m",
        ),
        (
            "manoeuvre: {kind: phases, phases: [{kind: climb, altitude_change: 30 km, length: 9 "
            "s}]}",
            "to 50000 m",
        ),
        ("manoeuvre: {kind: s_manoeuvre, offset: 50 km, length: 50 s}", "700 m/s"),
        (
            "manoeuvre: {kind: s_manoeuvre, offset: 5 km, length: 50 s, bank_time: 26 s}",
            "25 s",
        ),
        ("manoeuvre: {kind: level}\nlimits: {altitude: [30 km, 40 km]}", "20000 m"),
    ],
)
def test_an_invalid_mission_is_rejected(tmp_path, text, pattern):
    path = tmp_path / "mission.yaml"
    path.write_text(
        f"name: test\nstart: {{altitude: 20 km, speed: 1400 m/s, heading: 90 deg, latitude: "
        f"29.3 deg}}\n{text}\n"
    )
    with pytest.raises(InputError, match=pattern):
        read_mission(path)


WINDS, DENSITIES = "altitude_m,wind_north_mps,wind_east_mps\n", "altitude_m,density_factor\n"


@pytest.mark.parametrize(
    ("key", "text", "fragment"),
    [
        (
            "wind",
            f"{WINDS}0,1e300,1\n9,1,1\n",
            ":2:3: 'wind_north' is 1e+300 m/s; ",
        ),
        ("wind", f"{WINDS}0,1,1\n9,nan,1\n", ":3:3: found 'nan'"),
        ("wind", f"{WINDS}0,1,1\n9,1_0,1\n", ":3:3: found '1_0'"),
        ("wind", f"{WINDS}5,1,1\n5,1,1\n", ":3:1: "),
        ("wind", f"{WINDS}5,1,1\n", "found 1 row;"),
        ("density", f"{DENSITIES}0,0\n9,1\n", ":2:3: "),
        ("trajectory", ("10.0,", "9.0,"), ":12:1: "),
        ("trajectory", ("20000.0", "nan"), ":2:5: found 'nan'"),
        ("trajectory", ("60.0,", "59.5,"), "from 0 to 60 s"),
    ],
)
def test_errors_of_tables_give_their_location(tmp_path, key, text, fragment):
    file = Path(recorded(tmp_path)["file"])
    manoeuvre, table = {"kind": "level"}, {}
    if key == "trajectory":
        manoeuvre = {"kind": "recorded", "file": str(file)}
        file.write_text(file.read_text().replace(*text, 1))
    else:
        file.write_text(text)
        table = {key: {"file": str(file)}}
    mission = {"name": "test", "start": START, "manoeuvre": manoeuvre, **table}
    (tmp_path / "mission.yaml").write_text(json.dumps(mission))
    with pytest.raises(InputError) as caught:
        read_mission(tmp_path / "mission.yaml")
    assert fragment in str(caught.value)
