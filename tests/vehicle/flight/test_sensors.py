"""Sensor errors of all measurements: lag, scale, bias, noise, sampling and delay."""

import numpy as np
import pytest
from scipy.signal import lsim
from short_flights import rows_of, short_plan, write_law

from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.flight import sensors
from abhv_mc_vehicle.kernel.flight.interface import Z_ROWS
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import (
    ACCELERATIONS,
    ALL_SENSORS,
    MORE_SENSORS,
    SCALED_SENSORS,
)

DT = 0.01
WATCH = """\
from abhv_mc.extend import Command, controller

@controller(compiled=False)
def law(measured, reference):
    alpha, p = measured.angle_of_attack - reference.angle_of_attack, measured.roll_rate
    return Command(-0.1 * p, 0.0, reference.elevator + 2.0 * alpha, reference.equivalence_ratio, \
bank=measured.{name})
"""


def lanes_with(**errors):
    """Return the memory of one lane with sensor parameters."""
    Z = np.zeros((Z_ROWS, 1))
    for name in SCALED_SENSORS:
        Z[s.parameter_row(f"sensor.{name}_scale")] = 1.0
    for name, value in errors.items():
        Z[s.parameter_row(f"sensor.{name}")] = value
    return Z


def measure(Z, name, truth):
    """Return the measured values [tick] of a quantity from its true values."""
    row, measured = s.MEASURED + ALL_SENSORS.index(name), []
    active = sensors.active_sensor_errors(Z, 1)
    for tick, value in enumerate(truth):
        Z[s.MEASURED : s.MEASURED + s.N_SEEN] = 0.0
        Z[row] = value
        if active.changed:
            sensors.lag_and_scale(Z, 1, active, DT, tick)
        sensors.add_biases(Z, 1)
        sensors.sense(Z, 1, active, DT, tick)
        measured.append(Z[row, 0])
    return np.array(measured)


@pytest.mark.parametrize("lag", [0.002, 0.1])
def test_a_lag_is_the_first_order_answer_to_what_changes_steadily_between_ticks(lag):
    time = DT * np.arange(300)
    truth = 20e3 + 3.0 * np.sin(2.0 * time) + np.where(time > 1.0, 50.0 * (time - 1.0), 0.0)
    fine = np.linspace(0.0, time[-1], 100 * 299 + 1)
    _, late, _ = lsim(([1.0], [lag, 1.0]), np.interp(fine, time, truth) - truth[0], fine)
    measured = measure(lanes_with(altitude_lag=lag), "altitude", truth)
    np.testing.assert_allclose(measured, truth[0] + late[::100], atol=1e-7)


def test_the_lag_of_an_angle_passes_half_a_turn():
    rate = np.deg2rad(30.0)
    truth = np.deg2rad(170.0) + rate * DT * np.arange(300)
    measured = measure(lanes_with(heading_lag=0.2), "heading", np.angle(np.exp(1j * truth)))
    behind = np.angle(np.exp(1j * (truth - measured)))
    assert behind[-1] == pytest.approx(0.2 * rate, rel=1e-5)
    assert np.abs(measured).max() <= np.pi and np.ptp(measured) > 6.0


def test_scale_bias_sampling_and_delay_act_in_this_order():
    truth = 1400.0 + np.arange(40.0)
    errors = {"speed_scale": 1.01, "speed_bias": 5.0, "speed_interval": 0.043, "delay": 0.02}
    measured = measure(lanes_with(**errors), "speed", truth)
    sampled = 4 * (np.maximum(np.arange(40) - 2, 0) // 4)
    np.testing.assert_allclose(measured, 1.01 * truth[sampled] + 5.0, rtol=1e-15)


def test_noise_of_the_additional_measurements_has_separate_random_numbers():
    both = {"altitude_noise": 2.0, "noise_seed": 0.3}
    alone = measure(lanes_with(**both), "altitude", np.zeros(4000))
    np.testing.assert_array_equal(
        measure(lanes_with(**both, mach_noise=0.1), "altitude", np.zeros(4000)), alone
    )
    mach = measure(lanes_with(mach_noise=0.1, noise_seed=0.3), "mach", np.zeros(4000))
    assert np.std(mach) == pytest.approx(0.1, rel=0.05) and abs(np.mean(mach)) < 0.01
    assert abs(np.corrcoef(mach, alone)[0, 1]) < 0.05


# Channel and tolerance of measurements in an eastbound flight with 30 m/s of tail wind.
SEEN = {
    **{
        "airspeed": ("speed_mps", 0.014),
        "mach": ("mach", 5e-5),
        "load_factor": ("load_factor_g", 1e-3),
    },
    **{
        "roll": ("bank_deg", 0.05),
        "yaw": ("heading_deg", 0.1),
        "pitch": ("angle_of_attack_deg", 0.1),
    },
    **{"latitude": ("latitude_deg", 3e-5), "longitude": ("longitude_deg", 1e-6)},
    **{"north": ("north_m", 1e-3), "east": ("east_m", 4e-3)},
}


def test_noise_of_accelerations_is_random_numbers_of_their_own():
    errors = {"mach_noise": 0.1, "noise_seed": 0.4}
    alone = measure(lanes_with(**errors), "mach", np.zeros(4000))
    noises = {f"{name}_noise": 0.2 for name in ACCELERATIONS}
    np.testing.assert_array_equal(
        measure(lanes_with(**errors, **noises), "mach", np.zeros(4000)), alone
    )
    axes = [measure(lanes_with(**noises, noise_seed=0.4), x, np.zeros(4000)) for x in ACCELERATIONS]
    np.testing.assert_allclose(np.std(axes, axis=1), 0.2, rtol=0.05)
    assert np.abs(np.corrcoef([alone, *axes]) - np.eye(4)).max() < 0.05


@pytest.mark.parametrize("name", [*MORE_SENSORS, *ACCELERATIONS])
def test_a_custom_law_receives_additional_measurements_with_their_errors(tmp_path, name):
    plan = short_plan(30, write_law(tmp_path, WATCH.format(name=name)), "level")
    wind = {"wind.east": 30.0}
    block = fly(
        plan,
        rows_of(
            wind, wind | {f"sensor.{name}_bias": 0.25}, wind | {f"sensor.{name}_interval": 0.3}
        ),
        1,
    )
    history = block.history.astype(float)
    true, biased, sampled = np.deg2rad(history[:, :, CHANNEL_INDEX["bank_command_deg"]])
    if name in SEEN:
        expected = {channel: history[0, 20, i] for channel, i in CHANNEL_INDEX.items()}
        expected["angle_of_attack_deg"] *= 1.0 - 30.0 / expected["speed_mps"]  # to the ground
        expected["angle_of_attack_deg"] += expected["flight_path_angle_deg"]
        expected["speed_mps"] -= 30.0
        channel, tolerance = SEEN[name]
        measured = true[20] if name in SCALED_SENSORS else np.rad2deg(true[20])
        assert measured == pytest.approx(expected[channel], abs=tolerance)
    np.testing.assert_allclose(biased - true, 0.25, rtol=1e-3)  # histories are in single precision
    assert np.ptp(sampled[:30]) == 0.0 and sampled[0] == true[0]
    if name in SCALED_SENSORS:
        block = fly(plan, rows_of(wind | {f"sensor.{name}_scale": 1.1}), 1)
        scaled = np.deg2rad(block.history[0, :, CHANNEL_INDEX["bank_command_deg"]])
        np.testing.assert_allclose(scaled, 1.1 * true, rtol=1e-5, atol=1e-6)
