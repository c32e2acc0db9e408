"""Trim: angle of attack, elevator and equivalence ratio that balance a vehicle.

The nominal air of a mission is the standard atmosphere times the factors of the mission's table.

Forces in the plane of symmetry and the pitching moment about the centre of gravity are balanced
exactly, with zero aileron, rudder and sideslip. The method follows Zhu & Shen (2014), section 4.3,
but uses the full tables.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import joined
from abhv_mc_vehicle.kernel.plant.vehicle import COEFFICIENTS, Vehicle
from abhv_mc_vehicle.kernel.world.earth import WGS84, Earth, find_surroundings
from abhv_mc_vehicle.vehicle.actuators import deflection_range
from abhv_mc_vehicle.vehicle.vehicle_code import (
    N_THRUST,
    evaluate_coefficients,
    evaluate_fixed,
    evaluate_functions,
    evaluate_tables,
    make_variables,
)


def nominal_air(air: Floats | None, altitude: Any) -> tuple[Floats, Floats]:
    """Return density (kg/m3) and speed of sound (m/s) [point] at altitudes (m).

    ``air`` has the columns of :mod:`abhv_mc_vehicle.kernel.plant.air_data`; None or a table without
    rows is the standard atmosphere.
    """
    density, sound_speed, *_ = find_surroundings(WGS84, altitude, 0.0, 1.0)
    if air is None or not len(air):
        return density, sound_speed
    factor, warmth = (np.interp(altitude, air[:, 0], air[:, column]) for column in (3, 4))
    return density * factor, sound_speed * np.sqrt(warmth)


GRAVITY = 9.80665  # standard gravity, which defines load factors, m/s2
# tolerance of forces relative to the weight, and of moments relative to weight times chord
_TOLERANCE = 1e-8
_STEEPEST = -1.2  # lower limit of the flight path angle of a glide, rad
_USUAL = math.pi / 4.0  # preferred range of the angle of attack, rad
_STEP = 1e-13  # tolerance of a solution, in rad or as an equivalence ratio


class FlightPoint(NamedTuple):
    """Flight condition in SI units and radians; accelerations are 0 for steady flight."""

    altitude: float
    speed: float
    bank: float = 0.0
    latitude: float = 0.0
    heading: float = math.pi / 2.0
    flight_path_angle: float = 0.0
    speed_rate: float = 0.0  # time derivative of the speed
    flight_path_rate: float = 0.0  # time derivative of the flight path angle
    air: Floats | None = None  # nominal air of the mission, as in nominal_air
    # Contributions of custom dynamics: body x and z forces, N, and pitching moment, N m.
    push: tuple[float, float, float] = (0.0, 0.0, 0.0)


class TrimPoint(NamedTuple):
    """Controls at a flight point with the resulting forces, in SI units and radians."""

    angle_of_attack: float
    elevator: float
    equivalence_ratio: float
    flight_path_angle: float  # required flight path angle, or flight path angle of the glide
    forward: float  # force along the velocity, N
    upward: float  # force normal to the velocity in the plane of symmetry, N
    moment: float  # pitching moment about the centre of gravity, N m
    thrust: float  # thrust, N
    lift: float  # aerodynamic lift, N
    drag: float  # aerodynamic drag, N
    c_tn: float  # lift coefficient due to the thrust inclination e, T sin(e) cos(alpha) / (q S)
    load_factor: float  # force normal to the velocity divided by the weight at sea level
    fuel_flow: float  # fuel flow, kg/s
    mach: float
    dynamic_pressure: float  # dynamic pressure, Pa
    fault: str = ""  # reason why the controls do not trim the vehicle; empty if they do


def trim(
    vehicle: Vehicle, earth: Earth, point: FlightPoint, mass: float | None = None
) -> TrimPoint:
    """Trim a vehicle at a flight point; the default mass (kg) is its initial mass.

    A vehicle without an engine is trimmed on its glide path; the flight path angle of the point is
    ignored. If no glide path maintains the speed, only lift and moment are balanced, at the point's
    flight path angle.

    The Earth's rotation and the Coriolis acceleration are included. The aerodynamic pitch rate is
    that of the turn relative to the ground; the rotation of the local frame, which is equivalent to
    0.03 deg of elevator, is neglected. If no trim exists within the vehicle's limits, the result
    contains the nearest controls and a ``fault``.
    """
    mass = vehicle.constants.mass_start if mass is None else mass
    if vehicle.constants.equivalence_ratio_max > 0.0:
        return _balance(vehicle, earth, point, mass)[0]

    def forward(angle: float) -> float:
        return _balance(vehicle, earth, point._replace(flight_path_angle=angle), mass)[1]

    angle = _root(forward, _STEEPEST, 0.0, 1e-9)
    glide, left = _balance(vehicle, earth, point._replace(flight_path_angle=angle), mass)
    return glide if abs(left) < _TOLERANCE else _balance(vehicle, earth, point, mass)[0]


def _balance(
    vehicle: Vehicle, earth: Earth, point: FlightPoint, mass: float
) -> tuple[TrimPoint, float]:
    """Return the trim at the point's flight path angle, and the residual force / weight.

    The residual is the component along the velocity.
    """
    constants = vehicle.constants
    along, across = _specific_force(earth, point)
    sin_s = math.sin(point.bank)
    cos_s = math.cos(point.bank)
    pitch_rate = across * sin_s * sin_s / (cos_s * point.speed) + point.flight_path_rate * cos_s
    limits = deflection_range(vehicle, 2)
    density, sound = map(float, nominal_air(point.air, point.altitude))
    control = partial(_control, vehicle, point, mass, pitch_rate, (density, sound))

    @cache  # The nested searches evaluate four in ten points twice.
    def unbalance(alpha: float, elevator: float, eta: float) -> tuple[float, float, float]:
        """Return residual forces / weight, and residual pitching moment / (weight * chord)."""
        trial = control(alpha=alpha, elevator=elevator, eta=eta)
        weight = mass * GRAVITY
        return (
            trial.forward / weight - along / GRAVITY,
            trial.upward * cos_s / weight - across / GRAVITY,
            trial.moment / (weight * constants.chord),
        )

    # Each equation is solved for the control that affects it most. Nested searches are robust to
    # kinks of the tables.
    def eta_of(alpha: float, elevator: float) -> float:
        ends = (constants.equivalence_ratio_min, constants.equivalence_ratio_max)
        return _root(lambda eta: unbalance(alpha, elevator, eta)[0], *ends)

    def elevator_of(alpha: float) -> float:
        return _root(
            lambda elevator: unbalance(alpha, elevator, eta_of(alpha, elevator))[2], *limits
        )

    def lift_of(alpha: float) -> float:
        elevator = elevator_of(alpha)
        return unbalance(alpha, elevator, eta_of(alpha, elevator))[1]

    low = constants.angle_of_attack_min
    high = constants.angle_of_attack_max
    alpha = _root(lift_of, max(low, -_USUAL), min(high, _USUAL))
    if (low < -_USUAL or high > _USUAL) and abs(lift_of(alpha)) > _TOLERANCE:
        alpha = _root(lift_of, low, high)
    elevator = elevator_of(alpha)
    eta = eta_of(alpha, elevator)
    left = unbalance(alpha, elevator, eta)
    engine = constants.equivalence_ratio_max > 0.0
    names = ("throttle" if engine else "flight path angle", "angle of attack", "elevator")
    lacking = [name for name, share in zip(names, left, strict=True) if abs(share) > _TOLERANCE]
    fault = f"no {joined(lacking, 'or')} within limits trims the vehicle" if lacking else ""
    balanced = control(alpha=alpha, elevator=elevator, eta=eta)
    return balanced._replace(fault=fault), left[0]


def _root(
    function: Callable[[float], float], low: float, high: float, step: float = _STEP
) -> float:
    """Return a root in [low, high], or the end with the smaller residual if there is none."""
    from scipy.optimize import brentq

    end_values = {low: function(low), high: function(high)}
    if end_values[low] * end_values[high] > 0.0 or low == high:
        return low if abs(end_values[low]) < abs(end_values[high]) else high

    def once(
        x: float,
        # Brent's method would evaluate both ends of the interval again, which would take most of
        # the time of nested searches.
    ) -> float:
        return end_values[x] if x in end_values else function(x)

    return float(brentq(once, low, high, xtol=step, rtol=1e-14))


def _specific_force(earth: Earth, point: FlightPoint) -> tuple[float, float]:
    """Return the required non-gravitational specific force, m/s2.

    The components are along the velocity, and normal to it in the vertical plane, upward.
    """
    sin_lat = math.sin(point.latitude)
    cos_lat = math.cos(point.latitude)
    _, _, north, down, meridian, vertical = find_surroundings(
        earth, point.altitude, sin_lat, cos_lat
    )
    sin_g = math.sin(point.flight_path_angle)
    cos_g = math.cos(point.flight_path_angle)
    sin_h = math.sin(point.heading)
    cos_h = math.cos(point.heading)
    forward = np.array([cos_g * cos_h, cos_g * sin_h, -sin_g])
    up = np.array([-sin_g * cos_h, -sin_g * sin_h, -cos_g])
    velocity = point.speed * forward
    lon_rate = velocity[1] / ((vertical + point.altitude) * cos_lat)
    lat_rate = velocity[0] / (meridian + point.altitude)
    frame = np.array(
        [lon_rate * cos_lat, -lat_rate, -lon_rate * sin_lat]
    )  # rotation of the local frame relative to the Earth
    rotation = earth.rotation_rate * np.array([cos_lat, 0.0, -sin_lat])
    carried = np.cross(frame + 2.0 * rotation, velocity) - np.array([north, 0.0, down])
    return float(point.speed_rate + carried @ forward), float(
        point.speed * point.flight_path_rate + carried @ up
    )


def _control(
    vehicle: Vehicle,
    point: FlightPoint,
    mass: float,
    pitch_rate: float,
    air: tuple[float, float],
    *,
    alpha: float,
    elevator: float,
    eta: float,
) -> TrimPoint:
    """Return forces and moments for the given controls, which need not trim the vehicle."""
    constants = vehicle.constants
    density, sound = air
    q_bar = 0.5 * density * point.speed**2
    variables = make_variables(
        vehicle,
        mach=point.speed / sound,
        angle_of_attack=alpha,
        elevator=elevator,
        equivalence_ratio=eta,
        altitude=point.altitude,
        mass=mass,
        pitch_rate_hat=pitch_rate * constants.chord / (2.0 * point.speed),
    )
    rows = evaluate_tables(vehicle.tables, variables)
    values = evaluate_coefficients(vehicle, variables, rows=rows)[:, 0].tolist()
    coefficients = dict(zip(COEFFICIENTS, values, strict=True))
    fixed = {
        name: float(value[0]) for name, value in evaluate_fixed(vehicle, variables, rows).items()
    }
    lift, drag = (q_bar * constants.area * coefficients[name] for name in ("lift", "drag"))
    captured = constants.capture_thrust * eta * density * point.speed * fixed["capture_area_ratio"]
    thrust = captured * fixed["specific_impulse"] + q_bar * fixed["thrust_area"]

    sin_a = math.sin(alpha)
    cos_a = math.cos(alpha)
    x = lift * sin_a - drag * cos_a + thrust * constants.thrust_cos
    z = -lift * cos_a - drag * sin_a - thrust * constants.thrust_sin
    impulse = fixed["specific_impulse"]
    fuel_flow = thrust / (constants.standard_gravity * impulse) if impulse > 0.0 else 0.0
    propulsion = [0.0] * N_THRUST
    if vehicle.foreign.propulsion:
        propulsion = evaluate_functions(vehicle, variables, density, point.speed)[1][:, 0].tolist()
        x = x + propulsion[0]
        z = z + propulsion[2]
    cg_x = fixed["center_of_gravity_x"]
    cg_z = fixed["center_of_gravity_z"]
    moment = q_bar * constants.area * constants.chord * coefficients["pitching_moment"]
    moment += thrust * constants.thrust_cos * constants.thrust_offset_z + cg_x * z - cg_z * x
    if vehicle.foreign.propulsion:
        moment += (
            propulsion[4]
            + vehicle.foreign.engine_z * propulsion[0]
            - vehicle.foreign.engine_x * propulsion[2]
        )
        thrust = propulsion[0]
        fuel_flow = propulsion[6]
    x = x + point.push[0]
    z = z + point.push[1]
    moment = moment + point.push[2]
    upward = x * sin_a - z * cos_a
    return TrimPoint(
        angle_of_attack=alpha,
        elevator=elevator,
        equivalence_ratio=eta,
        flight_path_angle=point.flight_path_angle,
        forward=x * cos_a + z * sin_a,
        upward=upward,
        moment=moment,
        thrust=thrust,
        lift=lift,
        drag=drag,
        c_tn=thrust * constants.thrust_sin * cos_a / (q_bar * constants.area),
        load_factor=upward / (mass * GRAVITY),
        fuel_flow=fuel_flow,
        mach=point.speed / sound,
        dynamic_pressure=q_bar,
    )
