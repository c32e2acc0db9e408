"""Flying qualities against textbook formulas, and of an unstable vehicle."""

import math
from pathlib import Path

import numpy as np
import pytest

from abhv_mc_vehicle.control.design.flying_qualities import find_flying_qualities
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.plant.trim import FlightPoint, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
)

VEHICLES = Path(__file__).parents[4] / "configs" / "vehicle"
EARTH = WGS84._replace(rotation_rate=0.0)
POINT = FlightPoint(20e3, 1400.0, latitude=math.radians(29.3))
STEP = 1e-6


def qualities_of(name):
    vehicle = load_vehicle(VEHICLES / f"{name}.yaml")
    balanced = trim(vehicle, EARTH, POINT)
    mass = vehicle.constants.mass_start
    return find_flying_qualities(vehicle, EARTH, POINT, balanced, mass), balanced


def test_ghame_has_the_modes_of_the_textbook_formulas():
    """Compare with Etkin and Reid, Dynamics of Flight.

    Derivatives are central differences; the thrust acts through the centre of gravity.
    """
    vehicle = load_vehicle(VEHICLES / "ghame.yaml")
    qualities, trim_point = qualities_of("ghame")
    c, alpha, speed = vehicle.constants, trim_point.angle_of_attack, POINT.speed
    base = {
        "mach": trim_point.mach,
        "angle_of_attack": alpha,
        "elevator": trim_point.elevator,
        "equivalence_ratio": trim_point.equivalence_ratio,
        "altitude": POINT.altitude,
        "mass": c.mass_start,
    }

    def derivative(name):
        high, low = (
            evaluate_coefficients(
                vehicle, make_variables(vehicle, **base | {name: base.get(name, 0.0) + step})
            )[:, 0]
            for step in (STEP, -STEP)
        )
        coefficients = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
        return dict(zip(coefficients, ((high - low) / (2.0 * STEP)).tolist(), strict=True))

    by_alpha, by_beta = derivative("angle_of_attack"), derivative("sideslip")
    by_p, by_q, by_r = (derivative(f"{axis}_rate_hat") for axis in ("roll", "pitch", "yaw"))
    fixed = evaluate_fixed(vehicle, make_variables(vehicle, **base))
    jx, jy, jz, j13 = (float(fixed[f"inertia_{name}"][0]) for name in ("xx", "yy", "zz", "13"))
    pressure_area = trim_point.dynamic_pressure * c.area
    momentum = c.mass_start * speed

    def thrust(angle):
        rows = evaluate_fixed(vehicle, make_variables(vehicle, **base | {"angle_of_attack": angle}))
        return trim_point.thrust * float(
            rows["capture_area_ratio"][0] / fixed["capture_area_ratio"][0]
        )

    thrust_slope = (thrust(alpha + STEP) - thrust(alpha - STEP)) / (2.0 * STEP)
    lift_slope = pressure_area * by_alpha["CL"] + thrust_slope * math.sin(alpha)
    z_alpha = (lift_slope + trim_point.thrust * math.cos(alpha)) / momentum
    m_alpha = pressure_area * c.chord * by_alpha["Cm"] / jy
    m_q = pressure_area * c.chord * by_q["Cm"] * c.chord / (2.0 * speed) / jy
    frequency = math.sqrt(-m_alpha - m_q * z_alpha)
    assert qualities.static_margin == pytest.approx(-by_alpha["Cm"] / by_alpha["CL"], rel=1e-6)
    assert qualities.short_period_frequency == pytest.approx(frequency, rel=1e-5)
    assert qualities.short_period_damping == pytest.approx(
        (z_alpha - m_q) / (2.0 * frequency), rel=1e-5
    )
    assert qualities.pitch_time_to_double == math.inf

    inverse = np.linalg.inv([[jx, j13], [j13, jz]]) * pressure_area * c.span
    rate = c.span / (2.0 * speed)
    turn = inverse @ np.array(
        [
            [by_beta["Cl"], rate * by_p["Cl"], rate * by_r["Cl"]],
            [by_beta["Cn"], rate * by_p["Cn"], rate * by_r["Cn"]],
        ]
    )
    sine, cosine = math.sin(alpha), math.cos(alpha)
    # The side force is along body y; drag, in the plane of symmetry, has a component across the
    # velocity.
    side = (pressure_area * by_beta["CY"] + trim_point.drag - trim_point.thrust * cosine) / momentum
    weight = 9.747 / speed  # gravity at 20 km and 29.3 deg
    curving = trim_point.upward / momentum - weight
    lateral = np.array(
        [
            [0.0, curving, cosine, sine],
            [weight, side, sine, -cosine],
            [0.0, *turn[0]],
            [0.0, *turn[1]],
        ]
    )
    poles = np.linalg.eigvals(lateral)
    dutch_roll = poles[np.argmax(poles.imag)]
    assert qualities.dutch_roll_frequency == pytest.approx(abs(dutch_roll), rel=1e-3)
    assert qualities.dutch_roll_damping == pytest.approx(
        -dutch_roll.real / abs(dutch_roll), rel=1e-3
    )
    unit, roll, yaw = pressure_area * c.span / jz, turn[0, 0], turn[1, 0]
    assert qualities.cn_beta_dyn * unit == pytest.approx(yaw * cosine - roll * sine, rel=1e-6)
    by_aileron = derivative("aileron")
    rolled, yawed = inverse @ [by_aileron["Cl"], by_aileron["Cn"]]
    assert qualities.lcdp * unit == pytest.approx(yaw - roll * yawed / rolled, rel=1e-5)
    power = pressure_area * c.chord * derivative("elevator")["Cm"] / jy
    assert qualities.elevator_power == pytest.approx(power, rel=1e-6)


def test_an_unstable_vehicle_has_a_time_to_double_and_no_short_period():
    """The winged cone has its centre of gravity behind the neutral point at Mach 4.7."""
    qualities, _ = qualities_of("winged_cone")
    assert qualities.static_margin < 0.0
    assert math.isnan(qualities.short_period_frequency)
    assert math.isnan(qualities.short_period_damping)
    # The oscillation of its lateral motion is not a Dutch roll.
    assert qualities.cn_beta_dyn < 0.0 and qualities.lcdp < 0.0
    assert math.isnan(qualities.dutch_roll_frequency) and math.isnan(qualities.dutch_roll_damping)
    assert 0.1 < qualities.pitch_time_to_double < 10.0
