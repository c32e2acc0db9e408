"""Limits of a vehicle over the box of Mach number, angle of attack and altitude of its flights.

Derivatives are per rad about the centre of gravity. The vehicle has given Mach number, angle of
attack and altitude, trimmed or not, zero deflections and an equivalence ratio of 1. Cn_beta_dyn is
Cn_beta cos(alpha) - Iz/Ix Cl_beta sin(alpha), and LCDP is Cn_beta - Cl_beta Cn_da / Cl_da.
"""

from itertools import product

import numpy as np
from experiment import Floats
from paper_vehicle_sides import INFINITY, STILL, S, Side, polar

from abhv_mc_vehicle.control.design.design_model import make_environment
from abhv_mc_vehicle.control.design.lqr_design import Nominal, attitude_slopes
from abhv_mc_vehicle.kernel.plant.actuator_step import HIGH
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.vehicle.table_file import nodes_of
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_fixed, make_variables, table_rows

MACHS = np.linspace(4.0, 5.5, 7)
ALPHA_ENDS = np.deg2rad([-1.0, 12.0])
ALPHAS = np.linspace(*ALPHA_ENDS, 27)
ALTITUDES = (18e3, 20e3, 22e3, 24e3)
ETAS = np.linspace(1.0, 1.5, 11)
ENVELOPE = {
    "cn_beta_dyn": Side("Cn_beta_dyn, least in the box", 0.0, INFINITY, 0.05),
    "lcdp": Side("LCDP, least in the box", 0.0, INFINITY, 0.05),
    "cl_beta": Side("Cl_beta, most in the box", -INFINITY, 0.0, 0.05),
    "doubling": Side("lateral time to double, least in the box, s", 5.0, INFINITY, 5.0),
    "kink": Side("change of slopes over alpha, of the largest", -INFINITY, 0.15, 0.15),
    "held": Side("sideslip held by the rudder at its limit, deg", -INFINITY, 15.0, 15.0),
    "impulse_rise": Side("rise of the specific impulse beyond eta 1, s", -INFINITY, 0.0, 100.0),
    "inclination": Side("inclination of the thrust, deg", 3.0, 15.0, 3.0),
}


def measure_envelope(vehicle: Vehicle) -> dict[str, float]:
    """Return the traits of ENVELOPE; a motion that decays has an infinite time to double."""
    c = vehicle.constants
    mach, alpha = (x.ravel() for x in np.meshgrid(MACHS, ALPHAS))
    by_beta, by_aileron, by_rudder = (
        (polar(vehicle, mach, alpha, **{name: 0.01}) - polar(vehicle, mach, alpha))[[3, 5]] / 0.01
        for name in ("sideslip", "aileron", "rudder")
    )
    fixed = evaluate_fixed(vehicle, make_variables(vehicle, mass=c.mass_start))
    ratio = fixed["inertia_zz"] / fixed["inertia_xx"]
    growth = max(fastest_growth(vehicle, *point) for point in product(MACHS, ALPHAS, ALTITUDES))
    return {
        "cn_beta_dyn": float(
            (by_beta[1] * np.cos(alpha) - ratio * by_beta[0] * np.sin(alpha)).min()
        ),
        "lcdp": float((by_beta[1] - by_beta[0] * by_aileron[1] / by_aileron[0]).min()),
        "cl_beta": float(by_beta[0].max()),
        "doubling": float(np.log(2.0) / growth) if growth > 0.0 else INFINITY,
        "kink": largest_kink(vehicle),
        "held": float(
            np.rad2deg(vehicle.actuators[1, HIGH] * np.abs(by_rudder[1] / by_beta[1]).max())
        ),
        "impulse_rise": float(np.diff(impulses(vehicle), axis=0).max()),
        "inclination": float(np.rad2deg(np.arctan2(c.thrust_sin, c.thrust_cos))),
    }


def fastest_growth(vehicle: Vehicle, mach: float, alpha: float, altitude: float) -> float:
    """Return the largest real part (1/s) of the lateral modes in straight flight."""
    air = make_environment(STILL, altitude, S.start.latitude)
    nominal = Nominal(
        air,
        mass=vehicle.constants.mass_start,
        speed=mach * air.sound_speed,
        flight_path_angle=0.0,
        heading=S.start.heading,
        angle_of_attack=alpha,
        bank=0.0,
        equivalence_ratio=1.0,
        elevator=0.0,
    )
    lateral = attitude_slopes(vehicle, nominal)[np.ix_([1, 2, 3, 5], [1, 2, 3, 5])]
    return float(np.linalg.eigvals(lateral).real.max())


def largest_kink(vehicle: Vehicle) -> float:
    """Return the largest change of a table's slope between cells, relative to its largest slope."""
    nodes = nodes_of(vehicle.tables, "angle_of_attack")
    inside = nodes[(nodes > ALPHA_ENDS[0] + 1e-6) & (nodes < ALPHA_ENDS[1] - 1e-6)]
    alphas = np.array([ALPHA_ENDS[0], *inside, ALPHA_ENDS[1]])
    mach, alpha = (x.ravel() for x in np.meshgrid(MACHS, alphas, indexing="ij"))
    variables = make_variables(vehicle, mach=mach, angle_of_attack=alpha)
    rows = table_rows(vehicle.tables, variables).reshape(-1, MACHS.size, alphas.size)
    slopes = np.diff(rows, axis=2) / np.diff(alphas)
    largest = np.abs(slopes).max(axis=(1, 2))
    changes = np.abs(np.diff(slopes, axis=2)).max(axis=(1, 2))
    changing = largest > 1e-9 * np.abs(rows).max(axis=(1, 2))
    return float((changes[changing] / largest[changing]).max())


def impulses(vehicle: Vehicle) -> Floats:
    """Return the specific impulse (s) at the Mach numbers of the box [eta, Mach]."""
    eta, mach = (x.ravel() for x in np.meshgrid(ETAS, MACHS, indexing="ij"))
    variables = make_variables(vehicle, mach=mach, equivalence_ratio=eta)
    return evaluate_fixed(vehicle, variables)["specific_impulse"].reshape(ETAS.size, MACHS.size)
