"""Margins of flights, as a campaign asks for them."""

import numpy as np
import pytest
from vehicle.stability.systems import (
    flight_plan,
    linear_at_trim,
    parameters,
    read,
    stability_at_trim,
    steady_plan,
)

from abhv_mc_vehicle.flight.prepare import make_plan
from abhv_mc_vehicle.stability.analysis import analyse, make_rows, margins_of_flights


def test_the_least_margin_over_loops_and_times_counts():
    plan, steady = flight_plan("lqr_retuned_ghame_x", 3.0), steady_plan("lqr_retuned_ghame_x")
    single_times = [
        margins_of_flights(plan, steady, parameters(), [time]) for time in ("trim", 1.0)
    ]
    both = margins_of_flights(plan, steady, parameters(), ["trim", 1.0])
    np.testing.assert_allclose(
        both.table, np.minimum(single_times[0].table, single_times[1].table), rtol=1e-6
    )
    assert both.faults == [[""], [""]]
    gain, phase, delay, disk = single_times[0].table.T
    np.testing.assert_allclose(gain, 2.44, atol=0.01)  # the throttle's
    np.testing.assert_allclose(phase, 9.4, atol=0.06)
    np.testing.assert_allclose(delay, 10.5, atol=0.06)
    np.testing.assert_allclose(disk, 0.1408, atol=6e-5)


def test_200_frequencies_find_what_1000_find():
    dispersions = parameters(
        3, aero__lift=np.array([1.0, 0.9, 1.1]), atmosphere__density=np.array([1.0, 0.9, 1.1])
    )
    for controller in ("tlc", "lqr_retuned_ghame_x"):
        plan = steady_plan(controller)
        few, many = (
            margins_of_flights(plan, plan, dispersions, ["trim"], count) for count in (200, 1000)
        )
        np.testing.assert_allclose(few.table, many.table, rtol=1e-5)


def test_flights_without_margins_count_as_zero():
    plan, steady = flight_plan("tlc", 3.0), steady_plan("tlc")
    dispersions = parameters(3)
    dispersions[1] = parameters(control__aileron_effectiveness=0.7)  # unstable
    dispersions[2] = parameters(initial__sideslip=np.deg2rad(20.0))  # ends at once
    margins = margins_of_flights(plan, steady, dispersions, [2.0])
    ((fault, *faults, ended),) = margins.faults
    assert (fault, faults) == ("", ["unstable"]) and ended.endswith(" 2 s")
    assert (margins.table[0] > 0.0).all()
    np.testing.assert_array_equal(margins.table[1:], 0.0)


def test_a_command_behind_a_limit_counts_as_zero():
    vehicle, mission, law = read("tlc")
    narrow = law.model_copy(
        update={"limits": law.limits.model_copy(update={"angle_of_attack": (0.0, 0.05)})}
    )
    plan = make_plan(vehicle, mission.model_copy(update={"duration": 3.0}), narrow, "tlc")
    margins = margins_of_flights(plan, steady_plan("tlc"), parameters(), [2.0])
    assert " limit" in margins.faults[0][0]
    np.testing.assert_array_equal(margins.table, 0.0)


def test_a_delay_takes_what_the_delay_margin_says():
    plan = steady_plan("tlc")
    margins = margins_of_flights(
        plan, plan, parameters(3, sensor__delay=np.array([0.0, 0.08, 0.09])), ["trim"]
    )
    assert margins.faults == [
        ["", "", "unstable"]
    ]  # 87 ms in all loops at once, which is what a late measurement is
    assert 0.0 < margins.table[1, 2] < margins.table[0, 2] and not margins.table[2].any()


def test_rows_have_none_for_what_is_infinite():
    rows = make_rows("lqr_retuned_ghame_x", None, stability_at_trim("lqr_retuned_ghame_x"))
    assert (
        rows[1]["loop"] == "rudder"
        and rows[1]["gain_margin_low_db"] is None
        and rows[1]["stable"] is True
    )
    together = rows[4]
    assert (together.pop("controller"), together.pop("time_s"), together.pop("loop")) == (
        "lqr_retuned_ghame_x",
        None,
        "all",
    )
    expected = {
        "disk_margin": 0.1408,
        "disk_gain_db": 1.225,
        "disk_phase_deg": 8.05,
        "delay_margin_ms": 7.8,
    }
    assert together == pytest.approx(expected | {"stable": True}, rel=3e-3)


def test_a_loop_that_is_no_numbers_has_no_poles():
    """Check a density of 1e300 in a file of samples.

    It ended a campaign with numpy's LinAlgError after its last flight.
    """
    linear = linear_at_trim("lqr_retuned_ghame_x")
    stability = analyse(linear._replace(A=np.full_like(linear.A, np.nan)))
    assert not stability.stable.any() and stability.poles[0].size == 0
    assert np.isnan(stability.margins.gain_high).all()
