"""Random nominals over the envelope, and the design model's Jacobians there by complex step.

The design model is the right-hand sides (1), (13) and (3) of Zhu and Shen 2014 on a sphere that
does not turn, with the vehicle's own tables; nothing here looks at the gain formulas that it is
there to check.
"""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.shipped import shipped_configs
from abhv_mc_vehicle.control.controller_file import TlcController, read_controller
from abhv_mc_vehicle.control.design.design_model import (
    Environment,
    attitude_rates,
    body_rate_rates,
    guidance_rates,
    make_environment,
    slope,
    wrench_at,
)
from abhv_mc_vehicle.control.design.reference import make_mission_trim_tables, solve_reference
from abhv_mc_vehicle.control.design.trim_tables import trim_elevator
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.kernel.laws.tlc_loops import AttitudePoint, attitude_inverse
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import WGS84
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle

_STILL = (0.0, 0.0, 0.0)
SPHERE = WGS84._replace(flattening=0.0, j2=0.0, rotation_rate=0.0)

# Ranges of the random nominals, SI and radians; the speed is a Mach number until the altitude is
# known.
_RANGES = {
    "altitude": (18e3, 26e3),
    "latitude": (-0.9, 0.9),
    "mach": (4.3, 5.2),
    "flight_path_angle": (-0.3, 0.3),
    "heading": (-3.0, 3.0),
    "angle_of_attack": (-0.01, 0.20),
    "bank": (-1.2, 1.2),
    "equivalence_ratio": (0.1, 1.4),
    "mass": (1050.0, 1370.0),
    "angle_of_attack_rate": (-0.1, 0.1),
    "bank_rate": (-0.3, 0.3),
}


class Nominal(NamedTuple):
    """Return a random nominal in the envelope.

    The elevator is at trim, and the body turns as sub-loop 3 commands.
    """

    around: Environment
    values: dict[str, float]  # of _RANGES, and the speed
    elevator: float
    rates: tuple[float, float, float]  # p, q, r
    attitude: AttitudePoint


class Design(NamedTuple):
    """Design for which nominals are drawn."""

    vehicle: Vehicle
    reference: Floats  # [tick, column]
    trim_tables: Tables
    tlc: TlcController


def make_design():
    """Return nominals of the S manoeuvre.

    The thrust of the vehicle is inclined and offset, so every term contributes.
    """
    configs = shipped_configs()
    vehicle = load_vehicle(configs / "vehicle" / "ghame_x_coupled.yaml")
    mission = read_mission(configs / "mission" / "s_manoeuvre.yaml")
    trim_tables = make_mission_trim_tables(mission, vehicle)
    reference, _ = solve_reference(mission, vehicle, trim_tables, 0.1, 600)
    return Design(
        vehicle, reference, trim_tables, read_controller(configs / "control" / "tlc.yaml")
    )


def draw_nominals(design, count, seed=2014):
    """Random nominals over _RANGES."""
    low, high = np.array(list(_RANGES.values())).T
    draws = np.random.default_rng(seed).uniform(low, high, (count, low.size))
    return [
        _make_nominal(design.vehicle, dict(zip(_RANGES, draw.tolist(), strict=True)))
        for draw in draws
    ]


def _make_nominal(vehicle, values):
    around = make_environment(SPHERE, values["altitude"], values["latitude"])
    speed = values["mach"] * around.sound_speed
    alpha, bank, gamma = values["angle_of_attack"], values["bank"], values["flight_path_angle"]
    conditions = [np.array([x]) for x in (speed, alpha, values["equivalence_ratio"])]
    elevator = float(trim_elevator(vehicle, around, conditions[0], conditions[1], conditions[2])[0])

    # What the law reads from its tables: forces and their slopes over alpha and beta.
    def forces_of(x):
        """Force across and along the velocity, thrust along it."""

        def force(eta):
            deflections = (0.0, 0.0, elevator)
            return wrench_at(
                vehicle, around, values["mass"], speed, x[0], x[1], _STILL, deflections, eta
            ).force

        full, idle = force(values["equivalence_ratio"]), force(0.0)
        sa, ca = np.sin(x[0]), np.cos(x[0])
        drag = -(idle[0] * ca + idle[2] * sa)
        side = idle[1] * np.cos(x[1]) + drag * np.sin(x[1])
        thrust = full - idle
        return np.stack([full[0] * sa - full[2] * ca, side, thrust[0] * ca + thrust[2] * sa])

    angles = np.array([alpha, 0.0])
    normal, side, axial = np.real(forces_of(angles[:, None] + 0j))[:, 0].tolist()
    slopes = slope(forces_of, angles)
    attitude = AttitudePoint(
        values["mass"] * speed,
        around.gravity / speed,
        np.sin(alpha),
        np.cos(alpha),
        np.sin(bank),
        np.cos(bank),
        np.cos(gamma),
        np.tan(gamma),
        normal,
        float(slopes[0, 0]),
        axial,
        side,
        float(slopes[1, 1]),
    )
    rates = attitude_inverse(attitude, values["angle_of_attack_rate"], 0.0, values["bank_rate"])
    return Nominal(around, values | {"speed": speed}, elevator, rates, attitude)


def velocity_jacobian(design, nominal):
    """[4, 7]: rates of altitude, gamma, chi, V over these and alpha, bank, eta, from (1)."""
    names = (
        "altitude",
        "flight_path_angle",
        "heading",
        "speed",
        "angle_of_attack",
        "bank",
        "equivalence_ratio",
    )

    def rates_of(x):
        mass = nominal.values["mass"]
        return guidance_rates(
            design.vehicle, design.trim_tables, nominal.around, mass, x[:4], x[4:]
        )

    return slope(rates_of, [nominal.values[name] for name in names])


def attitude_jacobian(design, nominal):
    """Return the derivatives [3, 6] of the rates of alpha, beta and bank, from (13).

    Columns are these and p, q, r; forces do not depend on the rates.
    """
    values, around = nominal.values, nominal.around
    mass, speed = values["mass"], values["speed"]

    def rates_of(x):
        deflections, eta = (0.0, 0.0, nominal.elevator), values["equivalence_ratio"]
        flow = mass, speed, x[0], x[1], _STILL
        force = wrench_at(design.vehicle, around, *flow, deflections, eta).force
        return attitude_rates(
            force, mass, speed, around.gravity, values["flight_path_angle"], x[:3], x[3:]
        )

    return slope(rates_of, [values["angle_of_attack"], 0.0, values["bank"], *nominal.rates])


def inertia_of(design, nominal):
    """The inertia matrix [3, 3] at the nominal's mass, kg m2."""
    angle = np.array([nominal.values["angle_of_attack"]])
    mass, speed = nominal.values["mass"], nominal.values["speed"]
    wrench = wrench_at(
        design.vehicle, nominal.around, mass, speed, angle, 0.0 * angle, _STILL, _STILL, 0.0 * angle
    )
    return np.asarray(np.real(wrench.inertia[..., 0]))


def rate_jacobian(inertia, rates, moment):
    """[3, 6]: rates of p, q, r over these and the moments, from (3)."""

    def rates_of(x):
        return body_rate_rates(
            np.broadcast_to(inertia[..., None], (3, 3, x.shape[1])), x[3:], x[:3]
        )

    return slope(rates_of, [*rates, *moment])
