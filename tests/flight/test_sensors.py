"""Errors of sensors: lag, scale, bias, noise, sampling and delay, one after another, of all that a law may measure."""

import numpy as np
import pytest
from scipy.signal import lsim
from short_flights import rows_of, short_plan

from abhv_mc.flight.channels import CHANNEL_INDEX
from abhv_mc.flight.fly import fly
from abhv_mc.kernel.flight import sensors
from abhv_mc.kernel.flight.memory import Z_ROWS
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.parameter_names import ALL_SENSORS, MORE_SENSORS, SCALED_SENSORS
from abhv_mc.user_code.law_interface import Measured

DT = 0.01
WATCH = """\
from abhv_mc.extend import Command, controller

@controller(compiled=False)
def law(measured, reference):
    alpha, p = measured.angle_of_attack - reference.angle_of_attack, measured.roll_rate
    return Command(-0.1 * p, 0.0, reference.elevator + 2.0 * alpha, reference.equivalence_ratio, bank=measured.{name})
"""


def lanes_with(**errors):
    """The memory of a lane with parameters of sensors."""
    Z = np.zeros((Z_ROWS, 1))
    for name in SCALED_SENSORS:
        Z[s.parameter_row(f"sensor.{name}_scale")] = 1.0
    for name, value in errors.items():
        Z[s.parameter_row(f"sensor.{name}")] = value
    return Z


def measure(Z, name, truth):
    """What the sensor of a quantity makes of its true values [tick]."""
    row, found = s.MEASURED + ALL_SENSORS.index(name), []
    active = sensors.active_sensor_errors(Z, 1)
    for tick, value in enumerate(truth):
        Z[s.MEASURED : s.MEASURED + s.N_SEEN] = 0.0
        Z[row] = value
        if active.changed:
            sensors.lag_and_scale(Z, 1, DT, tick)
        sensors.add_biases(Z, 1)
        sensors.sense(Z, 1, active, DT, tick)
        found.append(Z[row, 0])
    return np.array(found)


def test_the_names_are_those_that_a_law_measures():
    assert Measured._fields == ALL_SENSORS


@pytest.mark.parametrize("lag", [0.002, 0.1])
def test_a_lag_is_the_first_order_answer_to_what_changes_steadily_between_ticks(lag):
    time = DT * np.arange(300)
    truth = 20e3 + 3.0 * np.sin(2.0 * time) + np.where(time > 1.0, 50.0 * (time - 1.0), 0.0)
    fine = np.linspace(0.0, time[-1], 100 * 299 + 1)
    _, late, _ = lsim(([1.0], [lag, 1.0]), np.interp(fine, time, truth) - truth[0], fine)
    found = measure(lanes_with(altitude_lag=lag), "altitude", truth)
    np.testing.assert_allclose(found, truth[0] + late[::100], atol=1e-7)


def test_an_angle_is_late_by_way_of_half_a_turn():
    rate = np.deg2rad(30.0)
    truth = np.deg2rad(170.0) + rate * DT * np.arange(300)
    found = measure(lanes_with(heading_lag=0.2), "heading", np.angle(np.exp(1j * truth)))
    behind = np.angle(np.exp(1j * (truth - found)))
    assert behind[-1] == pytest.approx(0.2 * rate, rel=1e-5)
    assert np.abs(found).max() <= np.pi and np.ptp(found) > 6.0


def test_what_is_sampled_is_scaled_off_and_then_held_and_delayed():
    truth = 1400.0 + np.arange(40.0)
    errors = {"speed_scale": 1.01, "speed_bias": 5.0, "speed_interval": 0.043, "delay": 0.02}
    found = measure(lanes_with(**errors), "speed", truth)
    sampled = 4 * (np.maximum(np.arange(40) - 2, 0) // 4)
    np.testing.assert_allclose(found, 1.01 * truth[sampled] + 5.0, rtol=1e-15)


def test_noise_of_what_user_laws_measure_besides_is_random_numbers_of_their_own():
    both = {"altitude_noise": 2.0, "noise_seed": 0.3}
    alone = measure(lanes_with(**both), "altitude", np.zeros(4000))
    np.testing.assert_array_equal(measure(lanes_with(**both, mach_noise=0.1), "altitude", np.zeros(4000)), alone)
    mach = measure(lanes_with(mach_noise=0.1, noise_seed=0.3), "mach", np.zeros(4000))
    assert np.std(mach) == pytest.approx(0.1, rel=0.05) and abs(np.mean(mach)) < 0.01
    assert abs(np.corrcoef(mach, alone)[0, 1]) < 0.05


@pytest.mark.parametrize("name", MORE_SENSORS)
def test_a_user_law_sees_the_errors_of_what_it_measures_besides(tmp_path, name):
    (tmp_path / "law.py").write_text(WATCH.format(name=name))
    (tmp_path / "law.yaml").write_text("law: python\nfile: law.py\nrate: 100 Hz\n")
    plan = short_plan(30, tmp_path / "law.yaml", "level")
    block = fly(plan, rows_of({}, {f"sensor.{name}_bias": 0.25}, {f"sensor.{name}_interval": 0.3}), 1)
    true, biased, held = np.deg2rad(block.history[:, :, CHANNEL_INDEX["bank_command_deg"]].astype(float))
    np.testing.assert_allclose(biased - true, 0.25, rtol=1e-3)  # histories are in single precision
    assert np.ptp(held[:30]) == 0.0 and held[0] == true[0]
    if name in SCALED_SENSORS:
        scaled = fly(plan, rows_of({f"sensor.{name}_scale": 1.1}), 1).history[0, :, CHANNEL_INDEX["bank_command_deg"]]
        np.testing.assert_allclose(np.deg2rad(scaled), 1.1 * true, rtol=1e-5, atol=1e-6)


def test_errors_of_a_neighbour_change_no_bit_of_a_flight():
    plan = short_plan(200, "lqr", "level")
    own = {"sensor.bank_noise": 0.01, "sensor.altitude_bias": 3.0}
    other = {
        "sensor.speed_lag": 0.1,
        "sensor.mach_noise": 0.1,
        "sensor.yaw_interval": 0.5,
        "sensor.altitude_scale": 1.1,
    }
    np.testing.assert_array_equal(fly(plan, rows_of(own), 1).history[0], fly(plan, rows_of(own, other), 1).history[0])
