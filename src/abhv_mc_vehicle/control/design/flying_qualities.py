"""Static margin, oscillatory modes and control power of a trimmed vehicle."""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Numbers
from abhv_mc_vehicle.control.design.design_model import make_environment, slope
from abhv_mc_vehicle.control.design.lqr_design import Nominal, attitude_slopes
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth
from abhv_mc_vehicle.plant.trim import FlightPoint, TrimPoint
from abhv_mc_vehicle.vehicle.vehicle_code import (
    evaluate_coefficients,
    evaluate_fixed,
    make_variables,
    moment_about_center,
    table_rows,
)

_ALPHA, _BETA, _BANK, _P, _Q, _R, _AILERON, _RUDDER, _ELEVATOR = range(9)


class FlyingQualities(NamedTuple):
    """Flying qualities at one trim point, SI and radians; NaN if a mode does not exist."""

    # static margin -dCm/dCL about the centre of gravity, without the engine, in chords
    static_margin: float
    short_period_frequency: float  # undamped short-period frequency, rad/s
    short_period_damping: float
    pitch_time_to_double: float  # time in which the pitch motion doubles, s; infinite if it decays
    dutch_roll_frequency: float  # undamped Dutch-roll frequency, rad/s
    dutch_roll_damping: float
    lateral_time_to_double: float
    aileron_power: float  # angular acceleration about the controlled axis per deflection, 1/s2
    rudder_power: float
    elevator_power: float
    cn_beta_dyn: float  # Cn_beta cos(alpha) - Iz/Ix Cl_beta sin(alpha), with the product of inertia
    lcdp: float  # Cn_beta - Cl_beta Cn_aileron / Cl_aileron, with the product of inertia


def find_flying_qualities(
    vehicle: Vehicle, earth: Earth, point: FlightPoint, trim: TrimPoint, mass: float
) -> FlyingQualities:
    """Linearize the attitude dynamics at a trim point at fixed speed and flight path.

    The short period involves angle of attack and pitch rate. The fastest oscillation of bank,
    sideslip, roll and yaw rate is the Dutch roll if its frequency is within a factor of 2 of the
    directional stiffness (Cn_beta_dyn); otherwise roll and spiral form it. Derivatives are taken
    within the current table cells.
    """
    nominal = Nominal(
        environment=make_environment(earth, point.altitude, point.latitude, point.air),
        mass=mass,
        speed=point.speed,
        flight_path_angle=trim.flight_path_angle,
        heading=point.heading,
        angle_of_attack=trim.angle_of_attack,
        bank=point.bank,
        equivalence_ratio=trim.equivalence_ratio,
        elevator=trim.elevator,
    )
    slopes = attitude_slopes(vehicle, nominal)
    pitch = slopes[np.ix_([_ALPHA, _Q], [_ALPHA, _Q])]
    lateral = np.linalg.eigvals(slopes[np.ix_(*2 * ([_BANK, _BETA, _P, _R],))])
    stiffness = float(np.linalg.det(pitch))
    short_period = math.sqrt(stiffness) if stiffness > 0.0 else math.nan
    roll = slopes[_P]
    yaw = slopes[_R]
    alpha = trim.angle_of_attack
    directional = float(yaw[_BETA] * math.cos(alpha) - roll[_BETA] * math.sin(alpha))
    dutch_roll = max(lateral[lateral.imag > 0.0], key=abs, default=complex(math.nan))
    if not directional / 4.0 <= abs(dutch_roll) ** 2 <= directional * 4.0:
        dutch_roll = complex(math.nan)
    inertia = evaluate_fixed(vehicle, make_variables(vehicle, mass=mass))["inertia_zz"].item()
    unit = inertia / (trim.dynamic_pressure * vehicle.constants.area * vehicle.constants.span)
    adverse = yaw[_AILERON] / roll[_AILERON] if roll[_AILERON] else math.nan
    return FlyingQualities(
        static_margin=_static_margin(vehicle, nominal),
        short_period_frequency=short_period,
        short_period_damping=-float(np.trace(pitch)) / (2.0 * short_period),
        pitch_time_to_double=_time_to_double(np.linalg.eigvals(pitch).real),
        dutch_roll_frequency=float(abs(dutch_roll)),
        dutch_roll_damping=-float(dutch_roll.real / abs(dutch_roll)),
        lateral_time_to_double=_time_to_double(lateral.real),
        aileron_power=float(slopes[_P, _AILERON]),
        rudder_power=float(slopes[_R, _RUDDER]),
        elevator_power=float(slopes[_Q, _ELEVATOR]),
        cn_beta_dyn=unit * directional,
        lcdp=unit * float(yaw[_BETA] - roll[_BETA] * adverse),
    )


def _static_margin(vehicle: Vehicle, nominal: Nominal) -> float:
    """Return -dCm/dCL at fixed elevator about the centre of gravity, without the engine."""

    def lift_and_moment(angle: Numbers) -> Numbers:
        alpha = angle[0]
        variables = make_variables(
            vehicle,
            mach=nominal.speed / nominal.environment.sound_speed,
            angle_of_attack=alpha,
            elevator=nominal.elevator,
            equivalence_ratio=nominal.equivalence_ratio,
            altitude=nominal.environment.altitude,
            mass=nominal.mass,
        )
        rows = table_rows(vehicle.tables, variables)
        coefficients = evaluate_coefficients(vehicle, variables, rows=rows)
        fixed = evaluate_fixed(vehicle, variables, rows)
        return np.stack([coefficients[0], moment_about_center(vehicle, coefficients, alpha, fixed)])

    by_lift, by_moment = slope(lift_and_moment, [nominal.angle_of_attack])[:, 0].tolist()
    return -by_moment / by_lift if by_lift else math.nan


def _time_to_double(real_parts: Numbers) -> float:
    """Return the time (s) in which the fastest growing mode doubles, infinite if all decay."""
    growth = float(np.max(np.real(real_parts)))
    return math.log(2.0) / growth if growth > 0.0 else math.inf
