"""Design model on a non-rotating sphere (Zhu and Shen 2014, equations 1, 3 and 13).

The model includes sideslip and thrust inclination. Arguments may be complex and have points as
their last axis, because Jacobians are computed by complex steps (Squire and Trapp, SIAM Review 40,
1998). Body axes point forward, right and down; units are SI and radians.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Numbers
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth, find_surroundings
from abhv_mc_vehicle.plant.trim import nominal_air
from abhv_mc_vehicle.vehicle.vehicle_code import (
    N_THRUST,
    evaluate_coefficients,
    evaluate_fixed,
    evaluate_functions,
    make_variables,
    table_rows,
)

_RISE = 1.0  # half step of the derivatives with respect to altitude, m
_STEP = 1e-30


def slope(function: Callable[[Numbers], Numbers], x: Any) -> Floats:
    """Return the Jacobian [..., output, input] at real vectors, from one call with complex steps.

    ``x`` contains the inputs, which are numbers or arrays [...]; the input of ``function`` has the
    shape [input, step, ...].
    """
    x = np.array(np.broadcast_arrays(*x), np.float64)
    steps = 1j * _STEP * np.eye(len(x)).reshape(len(x), len(x), *[1] * (x.ndim - 1))
    slopes = np.imag(function(x[:, None] + steps)) / _STEP
    return np.ascontiguousarray(np.moveaxis(slopes, (0, 1), (-2, -1)))


class Environment(NamedTuple):
    """Air and gravity at a nominal point, with derivatives with respect to altitude."""

    altitude: float  # altitude, m
    density: float  # air density, kg/m3
    sound_speed: float  # speed of sound, m/s
    gravity: float  # gravity, m/s2
    radius: float  # radius r of the rotation rate V / r, m
    latitude: float  # latitude, rad
    density_slope: float = 0.0  # change of density per metre of altitude, kg/m4
    sound_speed_slope: float = 0.0
    gravity_slope: float = 0.0


class EnvironmentPoints(NamedTuple):
    """Air and gravity at several points in SI units; each field has shape ``[point]``."""

    density: Floats
    sound_speed: Floats
    gravity: Floats  # down component of gravity
    radius: Floats  # distance to the centre of the Earth, M + h


def make_environment_points(
    earth: Earth, altitude: Floats, latitude: Floats, air: Floats | None = None
) -> EnvironmentPoints:
    """Return air, gravity and radius at geodetic altitudes (m) and latitudes (rad)."""
    *_, gravity, meridian, _ = find_surroundings(
        earth, altitude, np.sin(latitude), np.cos(latitude)
    )
    return EnvironmentPoints(*nominal_air(air, altitude), gravity, meridian + altitude)


def make_environment(
    earth: Earth, altitude: float, latitude: float, air: Floats | None = None
) -> Environment:
    """Return air and gravity at a point, with derivatives with respect to altitude."""
    low, middle, high = np.stack(
        make_environment_points(
            earth, altitude + np.array([-_RISE, 0.0, _RISE]), np.full(3, latitude), air
        ),
        axis=1,
    ).tolist()
    slopes = [(above - below) / (2.0 * _RISE) for above, below in zip(high, low, strict=True)]
    return Environment._make([altitude, *middle, latitude, *slopes[:3]])


class Wrench(NamedTuple):
    """Aerodynamic and thrust force and moment about the centre of gravity, in body axes."""

    force: Numbers  # force [3, ...], N
    moment: Numbers  # moment [3, ...], N m
    inertia: Numbers  # inertia matrix [3, 3, ...], kg m2


def engine_at(vehicle: Vehicle, variables: Numbers, density: Any, speed: Any) -> Numbers:
    """Return force (N), moment (N m) and fuel flow [7, ...] of the engine function.

    The moment refers to the same point as the aerodynamic moments. Without an engine function, all
    values are zero.
    """
    if not vehicle.foreign.propulsion:
        return np.zeros((N_THRUST, *variables.shape[1:]))
    _, wrench = evaluate_functions(vehicle, variables, density, speed)
    fx, fy, fz = wrench[:3]
    x = vehicle.foreign.engine_x
    z = vehicle.foreign.engine_z
    arm = np.stack([-z * fy, z * fx - x * fz, x * fy])
    return np.concatenate([wrench[:3], wrench[3:6] + arm, wrench[6:]])


def thrust_at(
    vehicle: Vehicle, fixed: dict[str, Numbers], eta: Any, density: Any, speed: Any
) -> Numbers:
    """Return the magnitude of the thrust, N, of an engine that is described by tables."""
    stream = vehicle.constants.capture_thrust * eta * density * speed * fixed["capture_area_ratio"]
    return np.asarray(
        stream * fixed["specific_impulse"] + 0.5 * density * speed * speed * fixed["thrust_area"]
    )


def guidance_rates(
    vehicle: Vehicle,
    trim_tables: Tables,
    environment: Environment,
    mass: float,
    state: Any,
    controls: Any,
) -> Numbers:
    """Return the rates of (altitude, gamma, chi, V) from trim-table data, equation (1)."""
    altitude, gamma, chi, speed = state
    alpha, bank, eta = controls
    rise = altitude - environment.altitude
    density = environment.density + environment.density_slope * rise
    sound_speed = environment.sound_speed + environment.sound_speed_slope * rise
    gravity = environment.gravity + environment.gravity_slope * rise
    radius = environment.radius + rise
    variables = make_variables(
        vehicle, mach=speed / sound_speed, angle_of_attack=alpha, equivalence_ratio=eta
    )
    _, lift, drag, thrust = (0.5 * density * speed**2 * vehicle.constants.area) * table_rows(
        trim_tables, variables
    )[:4]
    cos_line = vehicle.constants.thrust_cos
    sin_line = vehicle.constants.thrust_sin
    normal = lift + thrust * (np.sin(alpha) * cos_line + np.cos(alpha) * sin_line)
    axial = thrust * (np.cos(alpha) * cos_line - np.sin(alpha) * sin_line) - drag
    gamma_rate = normal * np.cos(bank) / (mass * speed) + (
        speed / radius - gravity / speed
    ) * np.cos(gamma)
    chi_rate = normal * np.sin(bank) / (mass * speed * np.cos(gamma)) + speed / radius * np.cos(
        gamma
    ) * np.sin(chi) * np.tan(environment.latitude)
    return np.stack(
        [speed * np.sin(gamma), gamma_rate, chi_rate, axial / mass - gravity * np.sin(gamma)]
    )


def wrench_at(
    vehicle: Vehicle,
    environment: Environment,
    mass: Any,
    speed: Any,
    alpha: Any,
    beta: Any,
    rates: Any,
    deflections: Any,
    eta: Any,
) -> Wrench:
    """Return the forces and moments computed from the full tables.

    ``rates`` contains (p, q, r), and ``deflections`` contains (aileron, rudder, elevator).
    """
    constants = vehicle.constants
    half_span = constants.span / (2.0 * speed)
    half_chord = constants.chord / (2.0 * speed)
    variables = make_variables(
        vehicle,
        mach=speed / environment.sound_speed,
        angle_of_attack=alpha,
        sideslip=beta,
        roll_rate_hat=rates[0] * half_span,
        pitch_rate_hat=rates[1] * half_chord,
        yaw_rate_hat=rates[2] * half_span,
        aileron=deflections[0],
        rudder=deflections[1],
        elevator=deflections[2],
        equivalence_ratio=eta,
        altitude=environment.altitude,
        mass=mass,
    )
    rows = table_rows(vehicle.tables, variables)
    fixed = evaluate_fixed(vehicle, variables, rows)
    lift, drag, side, rolling, pitching, yawing = evaluate_coefficients(
        vehicle, variables, rows=rows
    )
    sa = np.sin(alpha)
    ca = np.cos(alpha)
    sb = np.sin(beta)
    cb = np.cos(beta)
    forward = (
        np.stack([ca * cb, sb, sa * cb])
        if constants.drag_in_wind_axes
        else np.stack([ca, 0.0 * ca, sa])
    )
    up = np.stack([sa, 0.0 * sa, -ca])
    right = np.stack([0.0 * ca, 1.0 + 0.0 * ca, 0.0 * ca])
    pressure_area = 0.5 * environment.density * speed**2 * constants.area
    aero = pressure_area * (lift * up - drag * forward + side * right)
    size = thrust_at(vehicle, fixed, eta, environment.density, speed)
    thrust = np.stack([size * constants.thrust_cos, 0.0 * size, -size * constants.thrust_sin])
    engine = engine_at(vehicle, variables, environment.density, speed)
    moment = pressure_area * np.stack(
        [constants.span * rolling, constants.chord * pitching, constants.span * yawing]
    )
    # The lever arms extend from the centre of gravity to the moment reference and the thrust line.
    zero = 0.0 * fixed["center_of_gravity_x"]
    reference = np.stack([-fixed["center_of_gravity_x"], zero, -fixed["center_of_gravity_z"]])
    line = np.stack(
        [
            -fixed["center_of_gravity_x"],
            zero,
            constants.thrust_offset_z - fixed["center_of_gravity_z"],
        ]
    )
    moment = moment + np.cross(reference, aero, axis=0) + np.cross(line, thrust, axis=0)
    if vehicle.foreign.propulsion:
        moment = moment + engine[3:6] + np.cross(reference, engine[:3], axis=0)
        thrust = thrust + engine[:3]
    jx, jy, jz, j13 = (fixed[f"inertia_{name}"] for name in ("xx", "yy", "zz", "13"))
    inertia = np.array([[jx, zero, j13], [zero, jy, zero], [j13, zero, jz]])
    return Wrench(aero + thrust, moment, inertia)


def attitude_rates(
    force: Any, mass: Any, speed: Any, gravity: float, gamma: float, angles: Any, rates: Any
) -> Numbers:
    """Return the rates of (alpha, beta, bank) for a force and body rates, equation (13)."""
    alpha, beta, bank = angles
    p, q, r = rates
    sa = np.sin(alpha)
    ca = np.cos(alpha)
    sb = np.sin(beta)
    cb = np.cos(beta)
    side = (force[1] * cb - (force[0] * ca + force[2] * sa) * sb) / (mass * speed)
    normal = (force[0] * sa - force[2] * ca) / (mass * speed)
    weight = gravity / speed * np.cos(gamma)
    turning = normal - weight * np.cos(bank)
    roll = p * ca + r * sa
    alpha_rate = q - np.tan(beta) * roll - turning / cb
    beta_rate = p * sa - r * ca + side + weight * np.sin(bank)
    bank_rate = (
        roll / cb
        + np.tan(beta) * turning
        + np.tan(gamma) * (normal * np.sin(bank) + side * np.cos(bank))
    )
    return np.stack([alpha_rate, beta_rate, bank_rate])


def body_rate_rates(inertia: Any, moment: Any, rates: Any) -> Numbers:
    """Return the angular accelerations ``J^-1 (M - w x J w)``, equation (3)."""
    inertia = np.asarray(inertia)
    rates = np.asarray(rates)
    momentum = np.einsum("ij...,j...->i...", inertia, rates)
    torque = np.asarray(moment) - np.cross(rates, momentum, axis=0)
    matrices = np.moveaxis(inertia, (0, 1), (-2, -1))
    columns = np.moveaxis(torque, 0, -1)[..., None]
    return np.moveaxis(np.linalg.solve(matrices, columns)[..., 0], -1, 0)
