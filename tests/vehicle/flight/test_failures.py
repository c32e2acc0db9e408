"""Tests of failures in flight, including those of one of several engines.

They compare with an identical flight or with an independent expectation.
"""

from dataclasses import replace

import numpy as np
import pytest
from short_flights import rows_of, short_plan

from abhv_mc.flights.failure_cases import failure_cases, failure_times, is_failure_time
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.flight.metrics import METRIC_INDEX
from abhv_mc_vehicle.kernel.plant import failures
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import FAILURE_TIMES, NEVER, PARAMETER_NAMES, Inlet
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
)


@pytest.fixture(scope="module")
def plan():
    return short_plan(1500)


def _fly(plan, *cases, every=1):
    return fly(plan, rows_of(*cases), every, keep_states=True)


def _channel(block, flight, name):
    return block.history[flight, :, CHANNEL_INDEX[name]].astype(np.float64)


def _same(block, first, second):
    skip = METRIC_INDEX["engine_failed_s"]
    metrics = np.delete(block.metrics, skip, axis=1)
    return np.array_equal(metrics[first], metrics[second]) and np.array_equal(
        block.states[first], block.states[second], equal_nan=True
    )


def test_a_failure_after_the_end_changes_no_bit(plan):
    assert _same(_fly(plan, {}, dict.fromkeys(FAILURE_TIMES, 1e6)), 0, 1)


@pytest.mark.parametrize("time", [5.0, 5.004])
def test_it_acts_from_the_first_control_tick_at_or_after_its_time(plan, time):
    block = _fly(
        plan, {}, {"failure.elevator.loss_time": time, "failure.elevator.effectiveness": 0.5}
    )
    differs = (block.states[0] != block.states[1]).any(axis=1)
    acts = 500 if time == 5.0 else 501
    assert not differs[: acts + 1].any()
    assert differs[acts + 1]


# Failed from the start, each is the same as the parameter that says so of the whole flight.
_UNSTART = {"failure.engine.time": 0.0, "failure.engine.thrust": 1.0}


_EQUAL = [
    (
        {f"failure.{name}.slow_time": 0.0 for name in ("aileron", "rudder", "elevator")},
        {"actuator.rate_limit": 0.1},
    ),
    (_UNSTART | {"failure.engine.drag_increment": 0.004}, {"aero.drag.increment": 0.004}),
    (
        _UNSTART | {"failure.engine.pitching_moment_increment": 0.001},
        {"aero.pitching_moment.increment": 0.001},
    ),
    *(
        (
            {f"failure.{name}.loss_time": 0.0, f"failure.{name}.effectiveness": k},
            {f"control.{name}_effectiveness": k},
        )
        for name, k in (("elevator", 0.4), ("aileron", 0.7))
    ),
    (
        {"failure.sensor.angle_of_attack.time": 0.0, "failure.sensor.angle_of_attack.bias": 0.01},
        {"sensor.angle_of_attack_bias": 0.01},
    ),
]


@pytest.mark.parametrize(("failed", "equivalent"), _EQUAL, ids=lambda case: next(iter(case)))
def test_a_failure_from_the_start_equals_the_parameter_for_the_flight(plan, failed, equivalent):
    block = _fly(plan, failed, equivalent, {})
    assert _same(block, 0, 1)
    assert not _same(block, 0, 2)


def test_a_surface_sticks_at_its_position_or_is_driven_to_a_given_one(plan):
    target = np.deg2rad(3.0)
    block = _fly(
        plan,
        {"failure.elevator.stuck_time": 1.0},
        {"failure.elevator.stuck_time": 1.0, "failure.elevator.stuck_at": target},
    )
    elevator = block.states[:, :, s.ELEVATOR]
    position = elevator[0, 100]
    assert np.all(elevator[0, 100:] == position)
    assert np.all(block.states[0, 101:, s.ELEVATOR_RATE] == 0.0)
    assert elevator[1, 100] == position
    assert elevator[1, 140] == pytest.approx(target, abs=1e-4)  # 50 rad/s: settled after 0.4 s
    command = _channel(block, 0, "elevator_command_deg")
    assert np.ptp(command[100:]) > 0.01  # what the law asks for is still recorded


def path_acceleration(plan, block, share):
    """Return the speed and its rate along the flight path, from the tables by numpy.

    The engine gives a share of its thrust.
    """
    x, vehicle = block.states[0].T, plan.vehicle
    gamma, alpha = (
        np.deg2rad(_channel(block, 0, f"{name}_deg"))
        for name in ("flight_path_angle", "angle_of_attack")
    )
    speed = np.sqrt(np.sum(x[s.U : s.W + 1] ** 2, axis=0))
    density, _, _, sound = np.array([atmosphere(altitude) for altitude in x[s.ALTITUDE]]).T
    variables = make_variables(
        vehicle, mach=speed / sound, angle_of_attack=alpha, elevator=x[s.ELEVATOR],
        equivalence_ratio=x[s.ETA], altitude=x[s.ALTITUDE], mass=x[s.MASS],
    )  # fmt: skip
    c, q_bar, fixed = (
        vehicle.constants,
        0.5 * density * speed**2,
        evaluate_fixed(vehicle, variables),
    )
    drag = q_bar * c.area * evaluate_coefficients(vehicle, variables)[1]
    captured = c.capture_thrust * x[s.ETA] * density * speed * fixed["capture_area_ratio"]
    force = share * (captured * fixed["specific_impulse"] + q_bar * fixed["thrust_area"])
    gravity = 9.7932 * (6371e3 / (6371e3 + x[s.ALTITUDE])) ** 2  # at 29 deg of latitude
    return speed, (force * np.cos(alpha) - drag) / x[s.MASS] - gravity * np.sin(gamma)


@pytest.mark.parametrize(
    ("failure", "windows", "allowed"),
    [
        ({"failure.engine.time": 2.0}, [(400, 2000)], {"rel": 0.005}),  # a glide
        (
            {"failure.engine.time": 1.0, "failure.engine.duration": 2.0},
            [(0, 90), (90, 290), (290, 500)],
            {"abs": 0.01},
        ),  # a second's lag, twice
    ],
)
def test_speed_while_thrust_leaves_and_comes_back_is_that_of_an_independent_integration(
    failure, windows, allowed
):
    """The thrust a continuous first-order answer with the engine's lag."""
    ticks = windows[-1][1]
    level = short_plan(ticks, mission="level")
    block = _fly(level, failure)
    lag, time, fails = 2.0 * 1.0 / 20.0, 0.01 * np.arange(ticks + 1), failure["failure.engine.time"]
    back = fails + failure.get("failure.engine.duration", NEVER)
    share = np.where(time < fails, 1.0, np.exp(-np.maximum(time - fails, 0.0) / lag))
    share = np.where(time < back, share, 1.0 - np.exp(-np.maximum(time - back, 0.0) / lag))
    speed, rate = path_acceleration(level, block, share)
    for first, last in windows:
        expected = np.trapezoid(rate[first : last + 1], dx=0.01)
        assert speed[last] - speed[first] == pytest.approx(expected, **allowed)
    if back == NEVER:
        assert speed[-1] - speed[400] < -30.0
        assert np.ptp(block.states[0, 400:, s.MASS]) < 1e-6  # a flame-out burns no fuel
        assert block.metrics[0, METRIC_INDEX["engine_failed_s"]] == pytest.approx(18.0, abs=0.02)


def test_a_measurement_freezes_at_its_last_value_or_is_off(plan):
    fails = {"failure.sensor.speed.time": 0.02}
    block = _fly(plan, fails, fails | {"failure.sensor.speed.bias": 7.0})
    (frozen, true), (off, beside) = (
        [_channel(block, i, f"speed{end}_mps") for end in ("_measured", "")] for i in (0, 1)
    )
    assert (
        np.array_equal(frozen[:2], true[:2])
        and (frozen[2:] == true[1]).all()
        and (true[2:10] != true[1]).all()  # later the speed returns to it
    )
    assert off - beside == pytest.approx(
        7.0 * (np.arange(off.size) >= 2), abs=2e-4
    )  # histories are float32


def test_an_inlet_out_of_its_range_is_an_engine_failure_from_the_next_tick(plan):
    constants = plan.vehicle.constants._replace(inlet=Inlet(unstarts=1.0, mach_min=10.0))
    unstarts = replace(plan, vehicle=plan.vehicle._replace(constants=constants))
    mine, theirs = _fly(unstarts, {}), _fly(plan, {"failure.engine.time": 0.01})
    assert np.array_equal(mine.metrics, theirs.metrics)
    assert np.array_equal(mine.states, theirs.states)


def test_an_inlet_starts_again_after_its_delay_inside():
    Z, inlet = np.zeros((s.LAW, 1)), Inlet(unstarts=1.0, mach_min=4.0, restart_delay=0.03)
    mach = [5.0, 3.9, 3.9, 4.1, 4.1, 4.1, 4.1]
    failed = []
    for tick, value in enumerate(mach):
        Z[s.variable_row("mach")] = value
        failures.watch_inlet(Z, 1, inlet, 0.01 * tick)
        failed.append(float(Z[s.UNSTARTED, 0]))
    assert failed == [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]


def test_the_vehicles_own_effectors_fail_as_the_axes_that_they_are_mixed_from():
    cone = short_plan(300, mission="level_mach15", vehicle="winged_cone")
    lost, slow = {}, {}
    for i in range(2):  # both elevons, which make aileron and elevator
        lost |= {f"failure.effector_{i}.loss_time": 0.0, f"failure.effector_{i}.effectiveness": 0.6}
        slow |= {f"failure.effector_{i}.stuck_time": 1.0}
    axes = {"control.aileron_effectiveness": 0.6, "control.elevator_effectiveness": 0.6}
    stuck = {"failure.aileron.stuck_time": 1.0, "failure.elevator.stuck_time": 1.0}
    block = _fly(cone, lost, axes, slow, stuck, {})
    assert np.allclose(
        block.states[0], block.states[1], rtol=1e-7, atol=1e-8
    )  # the sums round otherwise
    # Stuck elevons hold the moment that a stuck aileron and elevator would; these stop a surface
    # dead in its motion.
    assert np.allclose(block.states[2, :, s.ALTITUDE], block.states[3, :, s.ALTITUDE], atol=0.05)
    assert not np.allclose(
        block.states[2, 200:, s.PITCH_RATE], block.states[4, 200:, s.PITCH_RATE], atol=1e-9
    )


def test_cases_name_what_failed_before_the_missions_end():
    names = (
        "aero.lift",
        "failure.engine.time",
        "failure.elevator.stuck_time",
        "failure.sensor.speed.time",
    )
    samples = np.array(
        [
            [1.0, NEVER, NEVER, NEVER],
            [1.0, 5.0, 70.0, NEVER],
            [1.0, 5.0, 4.0, 9.0],
            [1.0, NEVER, NEVER, NEVER],
        ]
    )
    cases = failure_cases(names, samples, np.full(4, 60.0), np.array([0.0, 55.0, 55.0, 2.0]))
    assert cases == [
        "none",
        "engine failed",
        "engine failed + elevator stuck + speed sensor",
        "engine unstart",
    ]
    assert failure_times(names, samples).tolist() == [NEVER, 5.0, 4.0, NEVER]
    assert tuple(filter(is_failure_time, PARAMETER_NAMES)) == FAILURE_TIMES


@pytest.fixture(scope="module")
def several():
    left, right = ({"share": 0.4, "y": y, "z": "-0.1 m"} for y in ("-0.6 m", "0.6 m"))
    engines = {"left": left, "right": right, "below": {"share": 0.2, "z": "0.4 m"}}
    return short_plan(
        100, mission="level", vehicle={"base": "ghame_x", "propulsion.engines": engines}
    )


def test_an_engine_out_takes_its_share_and_turns_the_vehicle(several):
    """The change of the body rates over the first tick against moment over inertia."""
    block = _fly(several, {}, {"failure.engine_0.time": 0.0}, {"failure.engine_2.time": 0.0})
    thrust = block.history[:, :, CHANNEL_INDEX["thrust_n"]].astype(float)
    eta = block.history[:, :, CHANNEL_INDEX["equivalence_ratio"]].astype(float)
    # TLC asks for more, at another angle of attack, where the inlet captures more.
    assert thrust[1, 60] / thrust[0, 60] / (eta[1, 60] / eta[0, 60]) == pytest.approx(0.6, abs=0.05)
    # The first tick: thrust falls by the mean of 1 - exp(-t / lag), and nothing has answered yet.
    lag = 2.0 * 1.0 / 20.0
    lost = 1.0 - lag / 0.01 * (1.0 - np.exp(-0.01 / lag))
    vehicle = several.vehicle
    fixed = evaluate_fixed(vehicle, make_variables(vehicle, mass=vehicle.constants.mass_start))
    total = thrust[0, 0]
    for flight, share, y, z in ((1, 0.4, -0.6, -0.1), (2, 0.2, 0.0, 0.4)):
        assert thrust[flight, 0] == pytest.approx(total * (1.0 - share * lost), rel=1e-6)
        change = (block.states[flight, 1] - block.states[0, 1])[s.ROLL_RATE : s.YAW_RATE + 1] / 0.01
        line = vehicle.constants.thrust_offset_z - fixed["center_of_gravity_z"][0]
        force = -total * share * lost
        pitch, yaw = (
            (line + z) * force / fixed["inertia_yy"][0],
            -y * force / fixed["inertia_zz"][0],
        )
        assert change[1] == pytest.approx(pitch, rel=2e-2)
        assert change[2] == pytest.approx(yaw, rel=2e-2, abs=1e-6)


def test_all_engines_out_is_the_engine_out(several):
    failures = {f"failure.engine_{i}.time": 0.3 for i in range(3)}
    block = _fly(
        several, failures, {"failure.engine.time": 0.3}, {"failure.engine_3.time": 0.3}, {}
    )
    assert np.abs(block.states[0] - block.states[1]).max() < 1e-9
    assert np.array_equal(block.states[2], block.states[3])  # there are three
