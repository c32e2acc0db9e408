"""Guidance trim: the equations hold over the envelope, and limits set the status."""

import re

import numpy as np
import pytest

from abhv_mc_vehicle.control.design.design_model import Environment, guidance_rates
from abhv_mc_vehicle.control.design.reference import trim_along, trim_faults
from abhv_mc_vehicle.kernel.laws.trim_lookup import (
    NO_ANGLE_OF_ATTACK,
    NO_BANK,
    NO_EQUIVALENCE_RATIO,
    GuidancePoints,
)
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.plant.trim import FlightPoint, trim

AROUND = Environment(20e3, 0.08891, 295.07, 9.757, 6.376e6, 0.511)
MASS = 1372.0
SPEED = 1400.0


def points(axial=0.0, vertical=0.0, lateral=0.0, speed=SPEED, gamma=0.0, heading=1.5):
    air = AROUND.density, AROUND.sound_speed, AROUND.gravity, AROUND.radius, AROUND.latitude
    columns = np.broadcast_arrays(
        np.atleast_1d(speed), *air, gamma, heading, axial, vertical, lateral
    )
    return GuidancePoints(*columns)


def rates(vehicle, tables, points, controls_found):
    """Return V', V gamma' and V chi' of the design model for nominal controls, [3, point]."""
    controls = np.stack(
        [controls_found.angle_of_attack, controls_found.bank, controls_found.equivalence_ratio]
    )
    state = np.stack(
        [
            np.full_like(points.speed, AROUND.altitude),
            points.flight_path_angle,
            points.heading,
            points.speed,
        ]
    )
    _, gamma_rate, chi_rate, speed_rate = guidance_rates(
        vehicle, tables, AROUND, MASS, state, controls
    )
    return np.real(np.stack([speed_rate, points.speed * gamma_rate, points.speed * chi_rate]))


def envelope(count):
    """Random accelerations up to 75 deg of bank, climbing and sinking, Mach 4.4 to 5."""
    generator = np.random.default_rng(3)
    bank = generator.uniform(np.deg2rad(-75.0), np.deg2rad(75.0), count)
    up = generator.uniform(4.0, 8.5, count)  # m/s2 of N cos(bank) / m
    gamma = generator.uniform(-0.1, 0.1, count)
    vertical = up + (SPEED**2 / AROUND.radius - AROUND.gravity) * np.cos(gamma)
    speed = generator.uniform(1300.0, 1480.0, count)
    axial = generator.uniform(-0.6, 0.1, count) - AROUND.gravity * np.sin(gamma)
    return points(axial, vertical, up * np.tan(bank) / np.cos(gamma), speed, gamma)


def test_equations_hold_over_the_envelope(vehicle, trim_tables):
    points = envelope(2000)
    nominal = trim_along(vehicle, trim_tables, points, MASS, warm_start=False)
    good = nominal.status == 0
    assert good.mean() > 0.9  # the others need more lift or thrust than available
    assert np.rad2deg(np.abs(nominal.bank[good])).max() > 70.0
    expected = np.stack([points.axial, points.longitudinal, points.lateral])
    error = np.abs(rates(vehicle, trim_tables, points, nominal) - expected)[:, good]
    assert error.max() < 1e-7  # m/s2
    # An equation is violated wherever the status says so.
    assert (
        np.abs(rates(vehicle, trim_tables, points, nominal) - expected).max(axis=0)[~good] > 1e-6
    ).all()


def test_a_warm_start_does_not_change_the_result(vehicle, trim_tables):
    lateral = np.array(
        [*9.8 * np.cos(np.linspace(0.0, np.pi, 1001)), 0.0, 9.8, -9.8]
    )  # the S, then steps
    warm = trim_along(vehicle, trim_tables, points(lateral=lateral), MASS)
    cold = trim_along(vehicle, trim_tables, points(lateral=lateral), MASS, warm_start=False)
    for a, b in zip(warm[:4], cold[:4], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


def test_an_interval_without_a_root_gives_its_nearest_end(vehicle, trim_tables):
    c = vehicle.constants
    faults = {}
    for name, acceleration, flag, control, end in (
        (
            "too fast",
            {"axial": 20.0},
            NO_EQUIVALENCE_RATIO,
            "equivalence_ratio",
            c.equivalence_ratio_max,
        ),
        (
            "too slow",
            {"axial": -50.0},
            NO_EQUIVALENCE_RATIO,
            "equivalence_ratio",
            c.equivalence_ratio_min,
        ),
        (
            "too much lift",
            {"vertical": 300.0},
            NO_ANGLE_OF_ATTACK,
            "angle_of_attack",
            c.angle_of_attack_max,
        ),
    ):
        faults[name] = trim_along(vehicle, trim_tables, points(**acceleration), MASS)
        assert faults[name].status[0] & flag
        assert getattr(faults[name], control)[0] == pytest.approx(end)
    down = trim_along(vehicle, trim_tables, points(vertical=-12.0, lateral=30.0), MASS)
    assert down.status[0] & (NO_BANK | NO_ANGLE_OF_ATTACK)
    (sentence,) = trim_faults(faults["too fast"], np.array([2.5]))
    assert re.search(r" 1 of 1 .* 2\.50 s\b.*\bthrottle\b", sentence)


def test_with_a_fixed_throttle_the_axial_equation_is_skipped(vehicle, trim_tables):
    level_points = points(lateral=np.array([0.0, 5.0]))
    full = trim_along(vehicle, trim_tables, level_points, MASS)
    skipped = trim_along(
        vehicle,
        trim_tables,
        level_points,
        MASS,
        held_equivalence_ratio=float(full.equivalence_ratio[0]),
    )
    assert skipped.angle_of_attack[0] == pytest.approx(full.angle_of_attack[0], abs=1e-10)
    assert skipped.equivalence_ratio[1] == full.equivalence_ratio[0]
    error = rates(vehicle, trim_tables, level_points, skipped) - np.stack(
        [level_points.axial, level_points.longitudinal, level_points.lateral]
    )
    assert np.abs(error[1:]).max() < 1e-8


def test_the_mass_decreases_by_the_fuel_burnt(vehicle, trim_tables):
    level_points = points(axial=np.zeros(101))
    nominal = trim_along(vehicle, trim_tables, level_points, MASS, tick=0.5)
    start = trim(
        vehicle, WGS84._replace(rotation_rate=0.0), FlightPoint(20e3, SPEED, latitude=0.511), MASS
    )
    assert nominal.mass[0] == MASS
    assert (nominal.mass[0] - nominal.mass[1]) / 0.5 == pytest.approx(start.fuel_flow, rel=0.01)
    assert (np.diff(nominal.angle_of_attack) < 0.0).all()  # lighter needs less
