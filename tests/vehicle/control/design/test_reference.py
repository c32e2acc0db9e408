"""Reference of the S manoeuvre, and the motion under its nominal controls."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from abhv_mc_vehicle.control.design.design_model import Environment, guidance_rates
from abhv_mc_vehicle.control.design.reference import make_start_trim, solve_reference
from abhv_mc_vehicle.control.mission import Climb, Level
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE

Floats = NDArray[np.float64]
CONFIGS = Path(__file__).parents[4] / "configs"
Columns = dict[str, Floats]


def test_the_s_of_the_paper(column):
    """Compare with Zhu and Shen 2014, section 7.

    Heading 90 to 83.6 deg and back, 5 km north, initial bank 46 deg.
    """
    heading = np.rad2deg(column["heading"])
    assert heading[0] == pytest.approx(90.0)
    assert heading.min() == pytest.approx(
        90.0 - np.rad2deg(np.arcsin(np.pi * 5000.0 / (2.0 * 50.0 * 1400.0)))
    )
    assert heading.min() == pytest.approx(83.56, abs=0.005)
    assert heading[2500] == heading.min()
    assert heading[5000] == 90.0
    t = column["time"][:5001]
    np.testing.assert_allclose(
        column["north"][:5001], 2500.0 * (1.0 - np.cos(np.pi * t / 50.0)), atol=1e-6
    )
    assert column["north"][-1] == pytest.approx(5000.0, abs=1e-6)
    bank = np.rad2deg(column["bank"])
    assert -48.0 < bank[0] < -45.0  # to the left, without a ramp
    assert bank[4999] > 44.0
    assert abs(bank[5000]) < 1.5  # a great circle is no parallel: a little bank is left
    np.testing.assert_array_equal(column["altitude"], 20e3)
    np.testing.assert_array_equal(column["speed"], 1400.0)


def test_a_tick_at_a_step_has_the_value_after_it(column):
    bank = column["bank"]
    jumps = np.flatnonzero(np.abs(np.diff(bank)) > np.deg2rad(5.0))
    np.testing.assert_array_equal(jumps, [4999])  # the one at t = 0 is before the first tick
    unsettled = np.flatnonzero(column["settled"] == 0.0)
    np.testing.assert_array_equal(unsettled, [*range(500), *range(5000, 5500)])


def test_ramps_and_five_seconds_after_them_are_not_settled(mission, vehicle, trim_tables):
    ramped = mission.manoeuvre.model_copy(update={"bank_time": 2.0})
    changed = mission.model_copy(update={"manoeuvre": ramped, "start_time": 1.0})
    reference, _ = solve_reference(changed, vehicle, trim_tables, 0.1, 600)
    unsettled = np.flatnonzero(reference[:, REFERENCE.index("settled")] == 0.0)
    np.testing.assert_array_equal(
        unsettled, [*range(10, 80), *range(490, 560)]
    )  # 1 to 8 s, 49 to 56 s


def test_cross_track_is_positive_to_the_left(mission, vehicle, trim_tables):
    """The displacement of the reference along the track vector is y at any heading."""
    for heading in (0.3, 4.0):
        turned = mission.model_copy(
            update={"start": mission.start.model_copy(update={"heading": heading})}
        )
        reference, _ = solve_reference(turned, vehicle, trim_tables, 0.1, 600)
        value = {name: reference[:, i] for i, name in enumerate(REFERENCE)}
        y = value["north"] * value["track_north"] + value["east"] * value["track_east"]
        np.testing.assert_allclose(y[500], 5000.0, atol=1e-3)
        assert np.isclose(
            value["bank"][0], np.deg2rad(-46.8), atol=0.02
        )  # V chi tan(lat) / r differs


@pytest.mark.parametrize("kind", ["s_manoeuvre", "climb"])
def test_nominal_controls_follow_the_reference(mission, vehicle, trim_tables, kind):
    """In open loop the design model (1) with nominal controls stays on the reference for 20 s."""
    if kind == "climb":
        climb = Climb(kind="climb", altitude_change="1 km", length="40 s", speed_change="20 m/s")
        mission = mission.model_copy(update={"manoeuvre": climb, "start_time": 2.0})
    reference, trim = solve_reference(mission, vehicle, trim_tables, 0.02, 3000)
    assert not trim.status.any()
    value = {name: reference[:, i] for i, name in enumerate(REFERENCE)}
    t = value["time"]
    horizon = 20.0  # the phugoid and the unstable V-h drift stay small for so long

    def rates(time, state):
        def at(name):
            return float(np.interp(time, t, value[name]))

        environment = Environment(
            at("altitude"),
            at("density"),
            at("sound_speed"),
            at("gravity"),
            at("radius"),
            at("latitude"),
        )
        controls = np.array(
            [[at(name)] for name in ("angle_of_attack", "bank", "equivalence_ratio")]
        )
        return np.real(
            guidance_rates(vehicle, trim_tables, environment, at("mass"), state[:, None], controls)
        )[:, 0]

    start = [value[name][0] for name in ("altitude", "flight_path_angle", "heading", "speed")]
    flown = solve_ivp(rates, (0.0, horizon), start, rtol=1e-9, atol=1e-9, max_step=0.1)
    end = round(horizon / 0.02)
    altitude, gamma, chi, speed = flown.y[:, -1]
    assert altitude == pytest.approx(value["altitude"][end], abs=1.0)
    assert gamma == pytest.approx(value["flight_path_angle"][end], abs=2e-4)
    assert chi == pytest.approx(value["heading"][end], abs=1e-5)
    assert speed == pytest.approx(value["speed"][end], abs=0.02)


def test_start_trim_is_the_trim_of_the_reference_without_bank(mission, vehicle, trim_tables):
    level = mission.model_copy(update={"manoeuvre": Level(kind="level")})
    reference, _ = solve_reference(level, vehicle, trim_tables, 0.01, 10)
    value = dict(zip(REFERENCE, reference[0], strict=True))
    start = make_start_trim(level, vehicle)
    assert start.fault == ""
    assert np.rad2deg(start.angle_of_attack) == pytest.approx(
        np.rad2deg(value["angle_of_attack"]), abs=0.01
    )
    assert np.rad2deg(start.elevator) == pytest.approx(np.rad2deg(value["elevator"]), abs=0.02)
    assert start.equivalence_ratio == pytest.approx(value["equivalence_ratio"], abs=1e-3)


def test_mass_and_latitude_along_the_s(column):
    mass = column["mass"]
    assert (np.diff(mass) < 0.0).all()
    assert mass[0] == pytest.approx(1371.66, abs=0.01)
    assert 0.03 < 1.0 - mass[-1] / mass[0] < 0.08  # about 5 % in a minute
    meridian = (column["north"][5000]) / (column["latitude"][5000] - column["latitude"][0])
    assert meridian == pytest.approx(
        6350.73e3 + 20e3, abs=50.0
    )  # M of WGS-84 at 29.32 deg, and the altitude
