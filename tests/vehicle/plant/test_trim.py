import math

import pytest

from abhv_mc.shipped import find_input
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.plant.trim import FlightPoint, _specific_force, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
)

STILL = WGS84._replace(rotation_rate=0.0)
LATITUDE = math.radians(29.3)


def vehicle(name):
    return load_vehicle(find_input(name, "vehicle"))


# Rounded as printed: the flight-model specification for ghame, the deck's constants file for the
# others, which it gives at full scale: at 1 g, without pitch rate, they hold at any scale.
@pytest.mark.parametrize(
    ("name", "bank", "alpha", "elevator", "eta"),
    [
        ("ghame", 0, 3.59, -3.91, 0.710),
        ("ghame", 50, 4.47, -5.49, 0.705),
        ("ghame", 55, 4.76, -6.00, 0.703),
        ("ghame_x", 0, 3.519, -0.007, 1.0024),
        ("ghame_x_coupled", 0, 3.000, 0.000, 1.0212),
    ],
)
def test_published_trims(name, bank, alpha, elevator, eta):
    trimmed = trim(vehicle(name), STILL, FlightPoint(20e3, 1400.0, math.radians(bank), LATITUDE))
    assert not trimmed.fault
    figures = 3 if name != "ghame" else 2
    half = 0.6 * 10.0**-figures
    angles = math.degrees(trimmed.angle_of_attack), math.degrees(trimmed.elevator)
    assert angles == pytest.approx((alpha, elevator), abs=half)
    assert trimmed.equivalence_ratio == pytest.approx(eta, abs=0.1 * half)
    assert trimmed.mach == pytest.approx(4.744643)  # the deck's own check value at 20 km
    assert trimmed.dynamic_pressure == pytest.approx(87130.5, rel=2e-5)


@pytest.mark.parametrize(("bank", "c_tn"), [(0.0, 0.00626), (50.0, 0.00633)])
def test_coupled_lift_is_as_chosen(bank, c_tn):
    """Values from the deck's constants file, which leaves the cosine of the angle of attack out."""
    trimmed = trim(
        vehicle("ghame_x_coupled"), STILL, FlightPoint(20e3, 1400.0, math.radians(bank), LATITUDE)
    )
    assert trimmed.c_tn / math.cos(trimmed.angle_of_attack) == pytest.approx(c_tn, abs=7e-6)


def test_winged_cone_trims_near_the_published_angle():
    """Compare with the open literature on the winged cone.

    At Mach 15 and 110,000 ft it has 1.7 to 1.8 deg (136 t, Earth at rest).
    """
    trimmed = trim(vehicle("winged_cone"), STILL, FlightPoint(33.5e3, 4590.0))
    assert not trimmed.fault
    assert trimmed.mach == pytest.approx(15.0, abs=0.1)
    assert 1.65 < math.degrees(trimmed.angle_of_attack) < 1.8


@pytest.mark.parametrize("name", ["ghame_x_coupled", "winged_cone"])
def test_forces_and_moment_balance(name):
    """Newton's law written out for a banked climb that gathers speed, over an Earth at rest."""
    v, bank, gamma = vehicle(name), math.radians(-30.0), math.radians(1.0)
    point = FlightPoint(22e3, 1500.0, bank, 0.0, math.pi / 2.0, gamma, speed_rate=0.5)
    trimmed = trim(v, STILL._replace(flattening=0.0, j2=0.0), point)
    assert not trimmed.fault
    alpha, mass, c = trimmed.angle_of_attack, v.constants.mass_start, v.constants
    radius = STILL.equatorial_radius + 22e3
    g = STILL.gravitational_parameter / radius**2
    across_thrust = trimmed.lift + trimmed.thrust * (
        c.thrust_cos * math.sin(alpha) + c.thrust_sin * math.cos(alpha)
    )
    along_thrust = (
        trimmed.thrust * (c.thrust_cos * math.cos(alpha) - c.thrust_sin * math.sin(alpha))
        - trimmed.drag
    )
    assert along_thrust == pytest.approx(mass * (0.5 + g * math.sin(gamma)), rel=1e-6)
    relief = 1500.0**2 / radius
    assert across_thrust * math.cos(bank) == pytest.approx(
        mass * (g - relief) * math.cos(gamma), rel=1e-6
    )

    turn = across_thrust / mass * math.sin(bank) ** 2 / 1500.0  # the pitch rate of the turn
    variables = make_variables(
        v,
        mach=trimmed.mach,
        angle_of_attack=alpha,
        elevator=trimmed.elevator,
        equivalence_ratio=trimmed.equivalence_ratio,
        altitude=22e3,
        mass=mass,
        pitch_rate_hat=turn * c.chord / 3000.0,
    )
    cg_x = evaluate_fixed(v, variables)["center_of_gravity_x"][0]
    down = (
        -trimmed.lift * math.cos(alpha)
        - trimmed.drag * math.sin(alpha)
        - trimmed.thrust * c.thrust_sin
    )
    moment = trimmed.dynamic_pressure * c.area * c.chord * evaluate_coefficients(v, variables)[4, 0]
    moment += trimmed.thrust * c.thrust_cos * c.thrust_offset_z + cg_x * down
    assert abs(moment) < 1e-6 * mass * g * c.chord


def test_the_turning_earth_carries_an_eastbound_flight():
    v = vehicle("ghame")

    def lift(earth, heading):
        trimmed = trim(v, earth, FlightPoint(20e3, 1400.0, 0.0, LATITUDE, math.radians(heading)))
        return trimmed.lift + trimmed.thrust * math.sin(trimmed.angle_of_attack)

    mass = v.constants.mass_start
    coriolis = 2.0 * WGS84.rotation_rate * 1400.0 * math.cos(LATITUDE)
    assert lift(WGS84, 270) - lift(WGS84, 90) == pytest.approx(2.0 * mass * coriolis, rel=1e-3)
    centrifugal = WGS84.rotation_rate**2 * (6373e3 + 20e3) * math.cos(LATITUDE) ** 2
    north = 0.5 * (lift(WGS84, 0) + lift(WGS84, 180))
    still = 0.5 * (lift(STILL, 0) + lift(STILL, 180))
    assert still - north == pytest.approx(mass * centrifugal, rel=2e-2)


@pytest.mark.parametrize(
    ("point", "word"),
    [
        (FlightPoint(20e3, 1400.0, math.radians(88.0)), "angle of attack"),
        (FlightPoint(20e3, 1400.0, 0.0, speed_rate=100.0), "throttle"),
        (FlightPoint(20e3, 1400.0, 0.0, speed_rate=-100.0), "throttle"),
    ],
)
def test_what_cannot_be_balanced_says_why(point, word):
    trimmed = trim(vehicle("ghame"), STILL, point)
    assert word in trimmed.fault
    assert all(math.isfinite(x) for x in trimmed._replace(fault=0.0))
    assert trimmed.angle_of_attack <= math.radians(21.0) + 1e-12
    assert 0.05 <= trimmed.equivalence_ratio <= 2.0


@pytest.mark.parametrize("heading", [0.0, 60.0, -120.0])
def test_a_level_flight_over_a_sphere_needs_gravity_less_the_centripetal_acceleration(heading):
    """On a meridian or any other great circle, without rotation, also in a climb of 0.2 rad."""
    earth = WGS84._replace(flattening=0.0, j2=0.0, rotation_rate=0.0)
    radius = earth.equatorial_radius + 1e4
    gravity = earth.gravitational_parameter / radius**2
    for climb in (0.0, 0.2):
        point = FlightPoint(1e4, 3000.0, 0.0, 0.7, math.radians(heading), climb, 0.5, 1e-3)
        forces = _specific_force(earth, point)
        normal = (gravity - 3000.0**2 / radius) * math.cos(climb) + 3000.0 * 1e-3
        assert forces == pytest.approx((0.5 + gravity * math.sin(climb), normal), rel=1e-9)
