"""Failures in flight, each against what it must equal or an independent expectation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq
from short_flights import rows_of, short_plan

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.failure_case import failure_cases, failure_times
from abhv_mc.flight.fly import fly, nominal_parameters
from abhv_mc.flight.metrics import METRIC_INDEX
from abhv_mc.flight.plan import FlightPlan
from abhv_mc.kernel.plant import failures
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import FAILURE_TIMES, NEVER
from abhv_mc.kernel.plant.vehicle import Inlet
from abhv_mc.kernel.world.atmosphere import atmosphere
from abhv_mc.vehicle.evaluate import evaluate_coefficients, evaluate_fixed, make_variables


@pytest.fixture(scope="module")
def plan() -> FlightPlan:
    return short_plan(1500)


def _fly(plan: FlightPlan, *cases: dict[str, float], every: int = 1):
    return fly(plan, rows_of(*cases), every, keep_states=True)


def _channel(block, flight: int, name: str):
    return block.history[flight, :, CHANNEL_INDEX[name]].astype(np.float64)


def _same(block, one: int, other: int) -> bool:
    skip = METRIC_INDEX["engine_failed_s"]
    metrics = np.delete(block.metrics, skip, axis=1)
    return np.array_equal(metrics[one], metrics[other]) and np.array_equal(
        block.states[one], block.states[other], equal_nan=True
    )


def test_a_failure_after_the_end_changes_no_bit(plan: FlightPlan) -> None:
    block = _fly(plan, {}, dict.fromkeys(FAILURE_TIMES, 1e6))
    assert _same(block, 0, 1)


@pytest.mark.parametrize("time", [5.0, 5.004])
def test_it_acts_from_the_first_control_tick_at_or_after_its_time(plan: FlightPlan, time: float) -> None:
    block = _fly(plan, {}, {"failure.elevator.loss_time": time, "failure.elevator.effectiveness": 0.5})
    differs = (block.states[0] != block.states[1]).any(axis=1)
    acts = 500 if time == 5.0 else 501
    assert not differs[: acts + 1].any()
    assert differs[acts + 1]


# Failed from the start, each is the same as the parameter that says so of the whole flight.
_EQUAL = [
    (
        {"failure.elevator.loss_time": 0.0, "failure.elevator.effectiveness": 0.4},
        {"control.elevator_effectiveness": 0.4},
    ),
    (
        {"failure.aileron.loss_time": 0.0, "failure.aileron.effectiveness": 0.7},
        {"control.aileron_effectiveness": 0.7},
    ),
    (
        {f"failure.{name}.slow_time": 0.0 for name in ("aileron", "rudder", "elevator")},
        {"actuator.rate_limit": 0.1},
    ),
    (
        {"failure.engine.time": 0.0, "failure.engine.thrust": 1.0, "failure.engine.drag_increment": 0.004},
        {"aero.drag.increment": 0.004},
    ),
    (
        {
            "failure.engine.time": 0.0,
            "failure.engine.thrust": 1.0,
            "failure.engine.pitching_moment_increment": 0.001,
        },
        {"aero.pitching_moment.increment": 0.001},
    ),
    (
        {"failure.sensor.angle_of_attack.time": 0.0, "failure.sensor.angle_of_attack.bias": 0.01},
        {"sensor.angle_of_attack_bias": 0.01},
    ),
]


@pytest.mark.parametrize(("failed", "whole"), _EQUAL, ids=lambda case: next(iter(case)))
def test_failed_from_the_start_it_equals_the_parameter_of_the_whole_flight(
    plan: FlightPlan, failed: dict[str, float], whole: dict[str, float]
) -> None:
    block = _fly(plan, failed, whole, {})
    assert _same(block, 0, 1)
    assert not _same(block, 0, 2)


def test_a_surface_sticks_where_it_is_or_is_driven_where_it_is_told(plan: FlightPlan) -> None:
    told = np.deg2rad(3.0)
    block = _fly(
        plan,
        {"failure.elevator.stuck_time": 1.0},
        {"failure.elevator.stuck_time": 1.0, "failure.elevator.stuck_at": told},
    )
    elevator = block.states[:, :, s.ELEVATOR]
    here = elevator[0, 100]
    assert np.all(elevator[0, 100:] == here)
    assert np.all(block.states[0, 101:, s.ELEVATOR_RATE] == 0.0)
    assert elevator[1, 100] == here
    assert elevator[1, 140] == pytest.approx(told, abs=1e-4)  # 50 rad/s: settled after 0.4 s
    command = _channel(block, 0, "elevator_command_deg")
    assert np.ptp(command[100:]) > 0.01  # what the law asks for is still recorded


def _moment(plan: FlightPlan, states, alpha: float, thrust_share: float = 1.0) -> float:
    """Pitching moment about the centre of gravity, N m, from the tables by numpy; no rates."""
    constants, vehicle = plan.vehicle.constants, plan.vehicle
    density, _, _, sound = atmosphere(states[s.ALTITUDE])
    speed = np.sqrt(np.sum(states[s.U : s.W + 1] ** 2))
    variables = make_variables(
        vehicle, mach=speed / sound, angle_of_attack=alpha, elevator=states[s.ELEVATOR],
        equivalence_ratio=states[s.ETA], altitude=states[s.ALTITUDE], mass=states[s.MASS],
    )  # fmt: skip
    q_s = 0.5 * density * speed**2 * constants.area
    fixed = {name: float(value[0]) for name, value in evaluate_fixed(vehicle, variables).items()}
    thrust = constants.capture_thrust * states[s.ETA] * density * speed
    thrust *= fixed["capture_area_ratio"] * fixed["specific_impulse"] * thrust_share
    coefficient = float(evaluate_coefficients(vehicle, variables)[4, 0])
    return q_s * constants.chord * coefficient + thrust * constants.thrust_cos * constants.thrust_offset_z


def test_the_angle_of_attack_settles_at_a_stuck_elevators_trim() -> None:
    level = short_plan(2500, mission="level")
    block = _fly(level, {"failure.elevator.stuck_time": 0.0, "failure.elevator.stuck_at": np.deg2rad(-0.5)})
    alpha = np.deg2rad(_channel(block, 0, "angle_of_attack_deg"))[1500:]
    states = block.states[0, 1500:]
    trims = [brentq(lambda a, x=x: _moment(level, x, a), -0.05, 0.2) for x in states[::25]]
    assert np.rad2deg(np.mean(alpha)) == pytest.approx(np.rad2deg(np.mean(trims)), abs=0.1)
    nominal = np.rad2deg(level.reference[0, 8])
    assert abs(np.rad2deg(np.mean(trims)) - nominal) > 0.3  # the stuck elevator's trim is another


def test_the_glide_after_a_flame_out_is_that_of_an_independent_integration() -> None:
    level = short_plan(2000, mission="level")
    block = _fly(level, {"failure.engine.time": 2.0})
    states = block.states[0]
    gamma = np.deg2rad(_channel(block, 0, "flight_path_angle_deg"))
    alpha = np.deg2rad(_channel(block, 0, "angle_of_attack_deg"))
    speed = np.sqrt(np.sum(states[:, s.U : s.W + 1] ** 2, axis=1))
    vehicle, rows = level.vehicle, range(400, 2001)  # the thrust has decayed with the engine's lag
    rate = []
    for k in rows:  # V' = -D / m - g sin(gamma), with drag from the tables; drag is in the stability axes, beta 0
        x = states[k]
        density, _, _, sound = atmosphere(x[s.ALTITUDE])
        variables = make_variables(
            vehicle, mach=speed[k] / sound, angle_of_attack=alpha[k], elevator=x[s.ELEVATOR],
            equivalence_ratio=x[s.ETA], altitude=x[s.ALTITUDE], mass=x[s.MASS],
        )  # fmt: skip
        drag = 0.5 * density * speed[k] ** 2 * vehicle.constants.area * evaluate_coefficients(vehicle, variables)[1, 0]
        gravity = 9.7932 * (6371e3 / (6371e3 + x[s.ALTITUDE])) ** 2  # at 29 deg of latitude
        rate.append(-drag / x[s.MASS] - gravity * np.sin(gamma[k]))
    lost = np.trapezoid(rate, dx=0.01)
    assert lost < -30.0
    assert speed[2000] - speed[400] == pytest.approx(lost, rel=0.005)
    assert np.all(np.ptp(states[400:, s.MASS]) < 1e-6)  # a flame-out burns no fuel
    assert block.metrics[0, METRIC_INDEX["engine_failed_s"]] == pytest.approx(18.0, abs=0.02)


def test_thrust_leaves_and_comes_back_as_the_engines_lag_says() -> None:
    """Speed against an independent integration along the path flown, the thrust a continuous first-order answer."""
    level = short_plan(500, mission="level")
    block = _fly(level, {"failure.engine.time": 1.0, "failure.engine.duration": 2.0})
    states, vehicle = block.states[0], level.vehicle
    gamma, alpha = (np.deg2rad(_channel(block, 0, f"{name}_deg")) for name in ("flight_path_angle", "angle_of_attack"))
    speed = np.sqrt(np.sum(states[:, s.U : s.W + 1] ** 2, axis=1))
    lag, time = 2.0 * 1.0 / 20.0, 0.01 * np.arange(501)
    runs = np.where(time < 1.0, 1.0, np.exp(-np.maximum(time - 1.0, 0.0) / lag))
    runs = np.where(time < 3.0, runs, 1.0 - np.exp(-np.maximum(time - 3.0, 0.0) / lag))
    rate = []
    for k, x in enumerate(states):
        density, _, _, sound = atmosphere(x[s.ALTITUDE])
        variables = make_variables(
            vehicle, mach=speed[k] / sound, angle_of_attack=alpha[k], elevator=x[s.ELEVATOR],
            equivalence_ratio=x[s.ETA], altitude=x[s.ALTITUDE], mass=x[s.MASS],
        )  # fmt: skip
        c, q_bar, fixed = vehicle.constants, 0.5 * density * speed[k] ** 2, evaluate_fixed(vehicle, variables)
        drag = q_bar * c.area * evaluate_coefficients(vehicle, variables)[1, 0]
        captured = c.capture_thrust * x[s.ETA] * density * speed[k] * fixed["capture_area_ratio"][0]
        force = runs[k] * (captured * fixed["specific_impulse"][0] + q_bar * fixed["thrust_area"][0])
        gravity = 9.7932 * (6371e3 / (6371e3 + x[s.ALTITUDE])) ** 2  # at 29 deg of latitude
        rate.append((force * np.cos(alpha[k]) - drag) / x[s.MASS] - gravity * np.sin(gamma[k]))
    for first, last in ((0, 90), (90, 290), (290, 500)):
        expected = np.trapezoid(rate[first : last + 1], dx=0.01)
        assert speed[last] - speed[first] == pytest.approx(expected, abs=0.01)


def test_a_measurement_freezes_at_its_last_value_or_is_off() -> None:
    Z = np.zeros((s.LAW, 2))
    for lane in range(2):
        Z[s.P : s.P + s.N_PARAMETERS, lane] = nominal_parameters()[0]
    Z[s.parameter_row("failure.sensor.speed.time")] = 0.02
    Z[s.parameter_row("failure.sensor.speed.bias"), 1] = 7.0
    seen = []
    for tick in range(5):
        Z[s.MEASURED : s.COUNTED] = 100.0 + tick
        failures.fail_sensors(Z, 2, 0.01 * tick)
        seen.append(Z[s.M_SPEED].copy())
        assert np.all(Z[s.M_ALTITUDE] == 100.0 + tick)
    assert np.array_equal(np.array(seen)[:, 0], [100.0, 101.0, 101.0, 101.0, 101.0])
    assert np.array_equal(np.array(seen)[:, 1], [100.0, 101.0, 109.0, 110.0, 111.0])


def test_an_inlet_out_of_its_range_is_an_engine_failure_from_the_next_tick(plan: FlightPlan) -> None:
    constants = plan.vehicle.constants._replace(inlet=Inlet(unstarts=1.0, mach_min=10.0))
    unstarts = replace(plan, vehicle=plan.vehicle._replace(constants=constants))
    mine, theirs = _fly(unstarts, {}), _fly(plan, {"failure.engine.time": 0.01})
    assert np.array_equal(mine.metrics, theirs.metrics)
    assert np.array_equal(mine.states, theirs.states)


def test_an_inlet_starts_again_after_its_delay_inside() -> None:
    Z, inlet = np.zeros((s.LAW, 1)), Inlet(unstarts=1.0, mach_min=4.0, restart_delay=0.03)
    mach = [5.0, 3.9, 3.9, 4.1, 4.1, 4.1, 4.1]
    failed = []
    for tick, value in enumerate(mach):
        Z[s.variable_row("mach")] = value
        failures.watch_inlet(Z, 1, inlet, 0.01 * tick)
        failed.append(float(Z[s.UNSTARTED, 0]))
    assert failed == [0.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0]


def test_the_vehicles_own_effectors_fail_as_the_axes_that_they_are_mixed_from() -> None:
    cone = short_plan(300, mission="level_mach15", vehicle="winged_cone")
    lost, slow = {}, {}
    for i in range(2):  # both elevons, which make aileron and elevator
        lost |= {f"failure.effector_{i}.loss_time": 0.0, f"failure.effector_{i}.effectiveness": 0.6}
        slow |= {f"failure.effector_{i}.stuck_time": 1.0}
    axes = {"control.aileron_effectiveness": 0.6, "control.elevator_effectiveness": 0.6}
    stuck = {"failure.aileron.stuck_time": 1.0, "failure.elevator.stuck_time": 1.0}
    block = _fly(cone, lost, axes, slow, stuck, {})
    assert np.allclose(block.states[0], block.states[1], rtol=1e-7, atol=1e-8)  # the sums round otherwise
    # Stuck elevons hold the moment that a stuck aileron and elevator would; these stop a surface dead in its motion.
    assert np.allclose(block.states[2, :, s.ALTITUDE], block.states[3, :, s.ALTITUDE], atol=0.05)
    assert not np.allclose(block.states[2, 200:, s.PITCH_RATE], block.states[4, 200:, s.PITCH_RATE], atol=1e-9)


def test_cases_name_what_failed_before_the_missions_end() -> None:
    names = ("aero.lift", "failure.engine.time", "failure.elevator.stuck_time", "failure.sensor.speed.time")
    samples = np.array(
        [[1.0, NEVER, NEVER, NEVER], [1.0, 5.0, 70.0, NEVER], [1.0, 5.0, 4.0, 9.0], [1.0, NEVER, NEVER, NEVER]]
    )
    cases = failure_cases(names, samples, np.full(4, 60.0), np.array([0.0, 55.0, 55.0, 2.0]))
    assert cases == ["none", "engine failed", "engine failed + elevator stuck + speed sensor", "engine unstart"]
    assert failure_times(names, samples).tolist() == [NEVER, 5.0, 4.0, NEVER]
