"""Tests of measured accelerations: specific force against the derivative of the velocity."""

from dataclasses import replace

import numpy as np
import pytest
from short_flights import change_vehicle, rows_of, short_plan, write_law

from abhv_mc.flights.timing import Timing
from abhv_mc_vehicle.flight.channels import CHANNEL_INDEX
from abhv_mc_vehicle.flight.fly import fly
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.vehicle import ACCELERATIONS

# The law is stable for some seconds. It outputs the measurements as commanded bank and angles.
WATCH = """\
from abhv_mc.extend import Command, controller

@controller
def law(measured, reference):
    alpha, p = measured.angle_of_attack - reference.angle_of_attack, measured.roll_rate
    elevator = reference.elevator + 2.0 * alpha + 0.05 * (reference.time > 0.5)
    return Command(0.02 - 0.1 * p, 0.01, elevator, reference.equivalence_ratio, READ)
"""
READ = ", ".join(
    f"{command}=measured.{name}"
    for command, name in zip(
        ("flight_path_angle", "angle_of_attack", "bank"), ACCELERATIONS, strict=True
    )
)
COMMANDS = [
    CHANNEL_INDEX[f"{name}_command_deg"]
    for name in ("flight_path_angle", "angle_of_attack", "bank")
]


def seen_by(block):
    """Return the accelerations [flight, tick, axis] that the law has measured."""
    return np.deg2rad(block.history[:, :, COMMANDS].astype(float))


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    law = write_law(tmp_path_factory.mktemp("watch"), WATCH.replace("READ", READ))
    return short_plan(200, law, "level")


def to_inertial(states, times, earth):
    """Return position, velocity [tick, 3] and body axes [tick, 3, 3] in an inertial frame."""
    a, e2 = earth.equatorial_radius, earth.flattening * (2.0 - earth.flattening)
    h, latitude = states[:, s.ALTITUDE], states[:, s.LATITUDE]
    longitude = states[:, s.LONGITUDE] + earth.rotation_rate * times
    normal = a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    zero = np.zeros_like(h)
    up = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=-1,
    )
    east = np.stack([-np.sin(longitude), np.cos(longitude), zero], axis=-1)
    ned = np.stack([np.cross(up, east), east, -up], axis=-1)
    position = (normal + h)[:, None] * up - np.stack(
        [zero, zero, e2 * normal * np.sin(latitude)], -1
    )
    q0, q = states[:, s.Q0], states[:, s.Q1 : s.Q3 + 1]

    def rotate(v):
        return v + 2.0 * np.cross(q, np.cross(q, v) + q0[:, None] * v)

    to_ned = np.stack([rotate(np.tile(axis, (len(h), 1))) for axis in np.eye(3)], axis=-1)
    body = ned @ to_ned
    relative = np.einsum("tij,tj->ti", body, states[:, s.U : s.W + 1])
    spin = np.array([0.0, 0.0, earth.rotation_rate])
    return position, relative + np.cross(spin, position), body


def attraction(position, earth):
    """Return the gradient of the potential with J2 [tick, 3]; the Earth's axis is z."""
    r = np.linalg.norm(position, axis=1, keepdims=True)
    z2 = (position[:, 2:] / r) ** 2
    j2 = 1.5 * earth.j2 * (earth.equatorial_radius / r) ** 2
    factor = 1.0 + j2 * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2)
    return -earth.gravitational_parameter / r**3 * factor * position


def test_it_is_the_derivative_of_the_inertial_velocity_less_gravity(plan):
    steps = 10
    fine = replace(plan, timing=Timing(plan.timing.tick / steps, steps, plan.timing.ticks))
    block = fly(fine, rows_of({}), 1, keep_states=True)
    position, velocity, body = to_inertial(block.states[0], block.times, plan.earth)
    seen = np.einsum("tij,tj->ti", body, seen_by(block)[0])
    # Over a tick the velocity gains the integral of the acceleration: Simpson's rule over two
    # ticks.
    total = seen + attraction(position, plan.earth)
    gained = velocity[2:] - velocity[:-2]
    integral = (total[:-2] + 4.0 * total[1:-1] + total[2:]) * plan.timing.tick / 3.0
    smooth = np.r_[2:45, 60:150]  # away from the elevator's step
    np.testing.assert_allclose(
        gained[smooth] / (2.0 * plan.timing.tick),
        integral[smooth] / (2.0 * plan.timing.tick),
        atol=2e-3,
    )
    assert np.ptp(seen_by(block)[0], axis=0).min() > 0.05
    assert np.abs(seen[0]).max() > 5.0  # already at the first tick


def loads(block):
    """Return the specific force's magnitude [flight, tick] from the load factor channel, m/s2."""
    return 9.80665 * block.history[:, :, CHANNEL_INDEX["load_factor_g"]].astype(float)


def test_it_is_that_of_the_forces_at_the_tick_in_turbulence(plan):
    seeds = ({"wind.turbulence": 3.0, "wind.turbulence_seed": seed} for seed in (0.2, 0.7))
    block = fly(plan, rows_of(*seeds), 1)
    np.testing.assert_allclose(np.linalg.norm(seen_by(block), axis=2), loads(block), rtol=1e-6)
    assert np.ptp(loads(block)[0] - loads(block)[1]) > 0.05


def test_reading_it_changes_no_flight(tmp_path):
    blocks = []
    for name in ("speed", "acceleration_z"):
        (tmp_path / name).mkdir()
        law = write_law(tmp_path / name, WATCH.replace("READ", f"bank=0.0 * measured.{name}"))
        blocks.append(fly(short_plan(100, law, "level"), rows_of({"sensor.delay": 0.02}, {}), 1))
    assert np.array_equal(blocks[0].history, blocks[1].history, equal_nan=True)


PUSHED = """\
from abhv_mc.extend import Effect, Sensed, dynamics

@dynamics
def pushed(states, motion, air, controls, settings):
    return Effect(rates=(-states.lag,), force=(0.0, 0.0, -8000.0), \
sensed=Sensed(acceleration_z=0.5))
"""


def test_it_has_the_force_of_custom_dynamics_and_what_they_add(tmp_path):
    (tmp_path / "own.py").write_text(PUSHED, "utf-8")
    start = "limits: # a flight terminates outside these\n"
    keys = "dynamics:\n  file: own.py\n  states: {lag: m}\n"
    vehicle = change_vehicle(tmp_path, (start, keys + start), name="abhv")
    law = write_law(tmp_path, WATCH.replace("READ", READ))
    block = fly(short_plan(60, law, "level", vehicle), rows_of({}), 1)
    true = seen_by(block) - [0.0, 0.0, 0.5]
    np.testing.assert_allclose(np.linalg.norm(true, axis=2), loads(block), rtol=1e-6)
