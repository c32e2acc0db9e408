"""Tests of control laws with several rates and sensors that lag or hold.

The model of a period is compared with an independent one and with flights.
"""

from dataclasses import replace

import numpy as np
import pytest
from fake_flight import make_plan
from vehicle.stability.systems import (
    assert_neutral,
    assert_predicted,
    decibels,
    flight_plan,
    parameters,
    plans_of,
    steady_plan,
)

from abhv_mc.io.messages import InputError
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.plant.vehicle import PARAMETER_INDEX, SENSORS
from abhv_mc_vehicle.stability.analysis import analyse, margins_of_flights
from abhv_mc_vehicle.stability.lifted import _loci
from abhv_mc_vehicle.stability.linearize import closed_period, linearize, sensor_ticks
from abhv_mc_vehicle.stability.margins import loop_gains, make_loops
from abhv_mc_vehicle.stability.model_file import make_model
from abhv_mc_vehicle.stability.point_slopes import SWITCHES, find_period
from abhv_mc_vehicle.stability.points import flown_points
from abhv_mc_vehicle.stability.probe import law_tick
from abhv_mc_vehicle.stability.steady import trim_points

# Path and throttle at rates of their own over attitude and body rates at every tick.
LAW = """\
from typing import NamedTuple
from abhv_mc.extend import Command, controller

class Memory(NamedTuple):
    clock: float = 0.0
    mode: float = 0.0
    integral: float = 0.0
    alpha: float = 0.0
    eta: float = 0.0

@controller{how}
def law(measured, reference, memory, time, dt):
    clock, mode, integral, alpha, eta = memory
    speed = measured.speed - reference.speed
    path = throttle = True
    {rates}
    if path:
        alpha = reference.angle_of_attack - 0.9 * (measured.flight_path_angle - \
reference.flight_path_angle)
        alpha -= 1e-4 * (measured.altitude - reference.altitude)
    if throttle:
        eta = reference.equivalence_ratio - (0.02 + 0.01 * mode) * speed - 0.001 * integral
        integral += 0.1 * speed
    elevator = reference.elevator + 2.0 * (measured.angle_of_attack - alpha) + 1.5 * \
measured.pitch_rate
    bank, beta, p, r = measured.bank - reference.bank, measured.sideslip, measured.roll_rate, \
measured.yaw_rate
    aileron, rudder = -0.26 * bank - 1.2 * beta - 0.08 * p + 0.06 * r, -0.04 * bank - 0.2 * beta \
- 0.01 * p + 0.04 * r
    return Command(aileron, rudder, elevator, eta, angle_of_attack=alpha), Memory(clock, mode, \
integral, alpha, eta)
"""
COUNTER = "path = throttle = clock == 0.0; clock = (clock + 1.0) % 10.0"
HYSTERESIS = COUNTER + "; mode = 1.0 if speed > {0} else 0.0 if speed < -{0} else mode"


def plan_of(folder, rates, declared=0, how=""):
    (folder / "law.py").write_text(LAW.format(rates=rates, how=how))
    (folder / "law.yaml").write_text(
        f"law: python\nfile: law.py\nrate: 100 Hz\nperiod: {declared}\n"
    )
    return plans_of(folder / "law.yaml")[1]


def apart(linear, ticks):
    """Return the map over ``ticks`` [(path, throttle)] of the control law above.

    It is written by hand about the linear plant.
    """
    product = np.eye(18 + 3)
    sense = linear.sense[0]
    for path, throttle in ticks:
        A, B = np.eye(3), np.zeros((3, len(sense)))  # integral, alpha, eta
        if path:
            A[1], B[1, 2], B[1, 0] = 0.0, -0.9, -1e-4
        if throttle:
            B[0, 1] = 0.1
            A[2] = -0.001, 0.0, 0.0
            B[2, 1] = -0.02
        C, D = np.zeros((4, 3)), np.zeros((4, len(sense)))
        D[0, [6, 5, 7, 9]], D[1, [6, 5, 7, 9]] = (
            (-0.26, -1.2, -0.08, 0.06),
            (-0.04, -0.2, -0.01, 0.04),
        )
        D[2, [4, 8]] = 2.0, 1.5
        C[2], D[2] = C[2] - 2.0 * A[1], D[2] - 2.0 * B[1]
        C[3], D[3] = A[2], B[2]
        tick = np.block([[linear.A[0] + linear.B[0] @ D @ sense, linear.B[0] @ C], [B @ sense, A]])
        product = tick @ product
    return product


def assert_poles(linear, by_hand):
    """Compare the poles of a period with those of a map, and return the latter."""
    poles, expected = (np.linalg.eigvals(matrix) for matrix in (closed_period(linear, 0), by_hand))
    for pole in expected[np.abs(expected) > 1e-6]:
        assert np.abs(poles - pole).min() < 1e-8
    return expected


# ten 0.01 s are less than 0.1 s
SUM = "clock += dt; path = throttle = clock >= 0.1; clock = 0.0 if path else clock"
THREE = "path, throttle = clock % 4.0 == 0.0, clock % 10.0 == 0.0; clock = (clock + 1.0) % 20.0"


@pytest.mark.parametrize(
    (
        "rates",
        "ticks",
        "path",
        "throttle",
    ),  # of the period, and the ticks after which each is at work again
    [
        ("pass", 1, 1, 1),  # one rate
        (COUNTER, 10, 10, 10),  # counter
        pytest.param(
            "path = throttle = clock % 10.0 == 0.0; clock += 1.0",
            10,
            10,
            10,
            marks=pytest.mark.thorough,
        ),  # endless counter
        ("throttle = round(time / dt) % 3 == 0", 3, 1, 3),  # time
        pytest.param(SUM, 11, 11, 11, marks=pytest.mark.thorough),  # sum of dt
        pytest.param(THREE, 20, 4, 10, marks=pytest.mark.thorough),  # three rates
        pytest.param(HYSTERESIS.format(5.0), 10, 10, 10, marks=pytest.mark.thorough),  # mode
    ],
)
def test_the_map_of_a_period_is_one_computed_apart(tmp_path, rates, ticks, path, throttle):
    plan = plan_of(tmp_path, rates)
    trims = trim_points(plan, parameters())
    assert trims.faults == [""]
    assert find_period(plan).ticks == ticks
    linear = linearize(plan, trims.points)
    by_hand = apart(linear, [(k % path == 0, k % throttle == 0) for k in range(ticks)])
    expected_poles = assert_poles(linear, by_hand)
    slow, stability = (
        expected_poles[np.abs(expected_poles) > np.exp(-10.0 * 0.01 * ticks)],
        analyse(linear),
    )
    assert (
        max(np.abs(stability.poles[0] - np.log(pole) / (0.01 * ticks)).min() for pole in slow)
        < 1e-6
    )
    assert_neutral(linear, stability.margins)


@pytest.mark.parametrize("how", ["", pytest.param("(compiled=False)", marks=pytest.mark.thorough)])
def test_a_mode_that_stays_is_named(tmp_path, how):
    period = find_period(plan_of(tmp_path, HYSTERESIS.format(5.0), how=how))
    assert (period.ticks, period.modes) == (10, ("mode 0",))


@pytest.mark.parametrize(
    ("rates", "declared", "message"),
    [
        (
            "path = throttle = clock == 0.0; clock = (clock + 1.0) % 150.0",
            0,
            "within 100 ticks",
        ),
        (SUM, 10, "after 11 ticks, not 10"),
    ],
)
def test_a_law_without_the_period_is_refused(tmp_path, rates, declared, message):
    with pytest.raises(InputError, match=message):
        find_period(plan_of(tmp_path, rates, declared))


def test_a_law_that_switches_at_its_rest_has_no_margins(tmp_path):
    plan = plan_of(tmp_path, HYSTERESIS.format(1e-3))
    assert margins_of_flights(plan, plan, parameters(), ["trim"]).faults == [[SWITCHES]]


def test_a_law_of_one_rate_has_the_same_margins_over_ten_ticks(tmp_path):
    stabilities = []
    for declared in (0, 10):
        plan = plan_of(tmp_path, "pass", declared)
        linear = linearize(plan, trim_points(plan, parameters(sensor__delay=0.02)).points)
        stabilities.append(analyse(linear))
    for pole in stabilities[0].poles[0][np.abs(stabilities[0].poles[0]) < 10.0]:
        assert np.abs(stabilities[1].poles[0] - pole).min() < 1e-6
    single, lifted = (stability.margins for stability in stabilities)
    assert np.isfinite(single.phase[0, [0, 2, 3]]).all() and len(linear.phases) == 10
    for name in ("gain_low", "gain_high"):
        np.testing.assert_allclose(
            decibels(getattr(lifted, name)), decibels(getattr(single, name)), atol=0.01
        )
    for name, unit in (("phase", 180.0 / np.pi), ("delay", 1e3), ("all_delay", 1e3)):
        np.testing.assert_allclose(
            getattr(lifted, name) * unit, getattr(single, name) * unit, atol=0.01
        )
    for name in ("sensitivity", "disk", "all_disk", "crossover", "gain_high_frequency"):
        np.testing.assert_allclose(getattr(lifted, name), getattr(single, name), rtol=1e-3)


def test_a_period_may_begin_at_any_tick_of_a_flight(tmp_path):
    plan_of(tmp_path, COUNTER)
    plan, _ = plans_of(tmp_path / "law.yaml", seconds=2.0)
    assert_predicted(plan, parameters(propulsion__specific_impulse=1e9), 103, 11)
    poles = []
    for time in (1.0, 1.01):
        linear = linearize(plan, flown_points(plan, parameters(), time).points)
        poles.append(np.sort_complex(np.linalg.eigvals(closed_period(linear, 0))))
    np.testing.assert_allclose(poles[0], poles[1], atol=2e-4)


def at_trim(plan, **values):
    trims = trim_points(plan, parameters(**values))
    assert trims.faults == [""]
    return linearize(plan, trims.points), trims.points


def of_all(what, value):
    return {f"sensor__{name}_{what}": value for name in SENSORS}


def test_the_linear_models_predict_the_flight():
    late = {
        "sensor__angle_of_attack_lag": 0.05,
        "sensor__pitch_rate_lag": 0.02,
        "sensor__bank_lag": 0.004,
    }
    sampled = {
        "sensor__speed_interval": 0.05,
        "sensor__sideslip_interval": 0.02,
        "sensor__angle_of_attack_interval": 0.03,
    }
    errors = {"sensor__pitch_rate_scale": 1.3, "sensor__speed_scale": 0.98, "sensor__delay": 0.02}
    assert_predicted(flight_plan("tlc", 10.0), parameters(**late, **sampled, **errors), 301, 60)


@pytest.mark.parametrize("lag", [0.004, 0.08])
def test_one_lag_of_all_that_is_measured_multiplies_every_loop(lag):
    plan = steady_plan("lqr_retuned_ghame_x")
    without, with_lag = at_trim(plan)[0], at_trim(plan, **of_all("lag", lag))[0]
    assert not with_lag.phases
    omega = np.array([0.3, 3.0, 30.0])
    z, stays, share = (
        np.exp(0.01j * omega),
        np.exp(-0.01 / lag),
        (1.0 - np.exp(-0.01 / lag)) * lag / 0.01,
    )
    answer = ((1.0 - share) * z + share - stays) / (
        z - stays
    )  # 1 / (lag s + 1) with a first-order hold
    before, after = (
        loop_gains(make_loops(matrix), np.zeros(3, int), omega) for matrix in (without, with_lag)
    )
    np.testing.assert_allclose(after, answer[:, None, None] * before, rtol=1e-8)


@pytest.mark.parametrize("late", [0, 2])
def test_samples_that_are_held_and_late_are_the_map_computed_apart(late):
    """Model a law without memory whose command changes ``late`` ticks after every tenth.

    Returns [state, command] over ten ticks.
    """
    plan = steady_plan("lqr_retuned_ghame_x")
    linear, _ = at_trim(plan, **of_all("interval", 0.1), sensor__delay=0.01 * late)
    assert len(linear.phases) == 10
    A, B, D = linear.A[0], linear.B[0], at_trim(plan)[0].law_D[0] @ linear.sense[0]

    def sampled(ticks):
        inputs = [np.linalg.matrix_power(A, k) @ B for k in range(ticks)]
        return np.linalg.matrix_power(A, ticks), sum(inputs, np.zeros_like(B))

    (A_old, B_old), (A_new, B_new) = sampled(late), sampled(10 - late)
    by_hand = np.block([[A_new @ A_old + B_new @ D, A_new @ B_old], [D, np.zeros((4, 4))]])
    assert_poles(linear, by_hand)


def test_sensors_and_a_law_repeat_together(tmp_path):
    plan = plan_of(tmp_path, COUNTER)
    linear, points = at_trim(plan, sensor__speed_interval=0.04, sensor__bank_lag=0.02)
    assert len(linear.phases) == 20
    assert make_model(plan, points, linear)["law"]["states"][-2:] == ["bank_late", "speed_held"]
    assert analyse(linear).stable.all()
    with pytest.raises(InputError, match=r"\b110 ticks\b"):
        at_trim(plan, sensor__speed_interval=0.11)


def test_intervals_that_differ_between_flights_are_not_linearized_together():
    plan, rows = steady_plan("lqr_retuned_ghame_x"), parameters(2)
    rows[1] = parameters(sensor__speed_interval=0.1)[0]
    with pytest.raises(InputError, match="differ"):
        margins_of_flights(plan, plan, rows, ["trim"])


@pytest.mark.parametrize(("size", "expected"), [(30.0, 0.0), (3e4, 3e4)])
def test_loci_within_the_rounding_of_their_eigenvectors_are_zero(size, expected):
    """Nearly parallel eigenvectors amplify the rounding by 1 / angle, here a thousand times."""
    angle, rounding = 1e-3, 1e-13 * 1e3  # of a matrix whose norm is 1e3
    small = size * rounding
    matrix = np.array([[[small, (1.0 - small) / angle], [0.0, 1.0]]], complex)
    found = np.sort(np.abs(_loci(matrix)[0]))
    assert found == pytest.approx([expected * rounding, 1.0], rel=1e-3)


def test_sample_periods_are_the_nearest_whole_ticks():
    plan = make_plan("one")  # ticks of 0.1 s
    rows = parameters(6)
    rows[:, PARAMETER_INDEX["sensor.speed_interval"]] = 0.0, 0.04, 0.14, 0.16, 0.24, 0.3
    ticks = sensor_ticks(plan, rows)
    assert ticks[:, SENSORS.index("speed")].tolist() == [1, 1, 1, 2, 2, 3]
    assert (np.delete(ticks, SENSORS.index("speed"), axis=1) == 1).all()


def test_a_sensor_delay_is_the_nearest_number_of_ticks():
    plan = steady_plan("lqr_retuned_ghame_x")  # ticks of 0.01 s
    rows = parameters(3, sensor__delay=np.array([0.004, 0.014, 0.016]))
    assert linearize(plan, trim_points(plan, rows).points).delay.tolist() == [0, 1, 2]


@pytest.mark.parametrize("tick", [0, 150])
def test_a_tick_of_a_law_follows_its_row_of_the_reference(tick):
    plan = flight_plan("lqr_retuned_ghame_x", 3.0)
    points = flown_points(plan, parameters(), 0.0).points
    commands = []
    for own, others in ((0.0, 0.0), (0.0, 5.0), (5.0, 0.0)):
        reference = plan.reference.copy()
        reference[:, ref.SPEED] += np.where(np.arange(len(reference)) == tick, own, others)
        moved = replace(plan, reference=reference)
        commands.append(law_tick(moved, tick, points.measured, points.memory).command)
    assert np.array_equal(commands[0], commands[1])
    assert np.abs(commands[2] - commands[0]).max() > 0.01
