"""Requirements of the vehicle class: traits, and the sides (intervals) that contain them.

    python studies/paper_vehicle_sides.py [--smoke]

The script prints the traits of `abhv`, of the members of studies/paper_vehicle.json, of GHAME and
of the winged cone. Unless the name says otherwise, traits are for the Mach number of the S and the
trim at 1 g. Coefficients are about the centre of gravity, per rad, with rates as p b/2V, q c/2V and
r b/2V. Arms and the radius of pitch damping are at the span and chord of `abhv`, in m.
"""

import argparse
import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from experiment import ROOT, Floats
from paper_vehicle_box import BASE, MACH, make_vehicle

from abhv_mc_vehicle.control.design.design_model import Environment, make_environment, wrench_at
from abhv_mc_vehicle.control.design.lqr_design import Nominal, attitude_slopes
from abhv_mc_vehicle.control.mission import read_mission
from abhv_mc_vehicle.kernel.plant.vehicle import Vehicle
from abhv_mc_vehicle.plant.trim import GRAVITY, FlightPoint, trim
from abhv_mc_vehicle.user_code.vehicle_functions import load_vehicle
from abhv_mc_vehicle.vehicle.table_file import nodes_of
from abhv_mc_vehicle.vehicle.vehicle_code import evaluate_coefficients, make_variables, table_rows

INFINITY = float("inf")
MOST_EXCESS = 2.0  # upper limit of an excess, units
LEAST_MACH = 2.0  # of the vehicles' tables
HALF_LENGTH = 4.3  # m, the limit of arms about the centre of gravity
_STEP = 1e-30


@dataclass(frozen=True)
class Side:
    """Name of a trait, and the interval that contains it for members."""

    label: str
    low: float
    high: float
    unit: float  # of an excess

    def excess(self, value: float, inner: float) -> float:
        """Return the excess of a value in units, negative below; `inner` shortens both ends."""
        below = min(value - self.low - inner * self.unit, 0.0)
        above = max(value - self.high + inner * self.unit, 0.0)
        return float(np.clip((below + above) / self.unit, -MOST_EXCESS, MOST_EXCESS))


SIDES = {
    "drag_least": Side("CD, least of the nodes within the limits", 0.001, INFINITY, 0.001),
    "push_most": Side(
        "-CD cos(beta) + CY sin(beta), most within the limits", -INFINITY, 0.0, 0.005
    ),
    "lift_to_drag": Side("L/D at 1 g", 2.8, 5.0, 2.2),
    "kuechemann": Side("L/D over 4 (M + 3)/M, most above Mach 2", -INFINITY, 1.0, 1.0),
    "induced_drag": Side("induced-drag factor", 1.0, 2.0, 1.0),
    "thrust_to_weight": Side("thrust over weight at 1 g", 0.0, 0.6, 0.6),
    "wing_loading": Side("wing loading, kg/m2", 250.0, 600.0, 350.0),
    "lift_slope": Side("CL_alpha over GHAME's", 0.6, 1.4, 0.8),
    "margin_least": Side("static margin, least within the limits, % of the chord", 1.0, 8.0, 4.0),
    "margin_most": Side("static margin, most within the limits, % of the chord", 1.0, 8.0, 4.0),
    "side_slope": Side("CY_beta over CL_alpha", -1.0, 0.0, 1.0),
    "roll_damping": Side("Cl_p over CL_alpha", -0.18, -0.06, 0.12),
    "pitch_damping": Side("Cm_q", -5.0, -0.4, 2.5),
    "damping_radius": Side("radius of pitch damping, m", -INFINITY, HALF_LENGTH, 2.3),
    "yaw_damping": Side("Cn_r", -0.9, -0.1, 0.8),
    "rudder_damping": Side("yaw damping of the rudder over Cn_r", -INFINITY, 1.0, 0.5),
    "rudder_arm": Side("rudder arm -Cn_dr b/CY_dr, m", 1.5, HALF_LENGTH, 2.8),
    "rudder_height": Side("rudder height Cl_dr/CY_dr over the span", -0.5, 0.5, 0.5),
    "elevator_arm": Side("elevator arm -Cm_de c/CL_de, m", 2.0, HALF_LENGTH, 2.3),
    "dutch_roll": Side("bank over sideslip of the Dutch roll", 0.0, 10.0, 10.0),
}
SIDESLIPS = np.deg2rad(np.linspace(0.0, 15.0, 16))
DEFLECTION = np.deg2rad(20.0)
S = read_mission(ROOT / "configs/mission/s_manoeuvre.yaml")
STILL = S.make_earth()._replace(rotation_rate=0.0)
AROUND = make_environment(STILL, 20e3, S.start.latitude)
SPEED = MACH * AROUND.sound_speed
_STATES = ("alpha", "beta", "p", "q", "r", "aileron", "rudder", "elevator")


def coefficients_at(vehicle: Vehicle, around: Environment, state: Any) -> Any:
    """Return CL, CD, CY, Cl, Cm, Cn without thrust at `_STATES` [state, ...], rates as p b/2V."""
    c = vehicle.constants
    units = np.array([c.span, c.chord, c.span]) / (2.0 * SPEED)
    rates = [state[2 + i] / units[i] for i in range(3)]
    nothing = 0.0 * state[0]
    wrench = wrench_at(
        vehicle,
        around,
        c.mass_start,
        SPEED + nothing,
        state[0],
        state[1],
        rates,
        state[5:8],
        nothing,
    )
    pressure_area = 0.5 * around.density * SPEED**2 * c.area
    x, y, z = wrench.force / pressure_area
    sine, cosine = np.sin(state[0]), np.cos(state[0])
    lengths = (c.span, c.chord, c.span)
    moments = [
        m / (pressure_area * length) for m, length in zip(wrench.moment, lengths, strict=True)
    ]
    return np.stack([x * sine - z * cosine, -x * cosine - z * sine, y, *moments])


def slopes_at(vehicle: Vehicle, alpha: float, elevator: float) -> dict[tuple[str, str], float]:
    """Return the derivatives of each coefficient by `_STATES`."""
    state_values = np.zeros(len(_STATES))
    state_values[0], state_values[-1] = alpha, elevator
    steps = state_values[:, None] + 1j * _STEP * np.eye(state_values.size)
    slopes = np.imag(coefficients_at(vehicle, AROUND, steps)) / _STEP
    names = ("CL", "CD", "CY", "Cl", "Cm", "Cn")
    return {
        (name, state): float(slopes[i, j])
        for i, name in enumerate(names)
        for j, state in enumerate(_STATES)
    }


def nodes_within(vehicle: Vehicle) -> tuple[Floats, Floats]:
    """Return the nodes of Mach number and angle of attack (rad) within the limits."""
    low, high = (
        max(vehicle.constants.angle_of_attack_min, -0.5),
        min(vehicle.constants.angle_of_attack_max, 0.5),
    )
    alphas = nodes_of(vehicle.tables, "angle_of_attack")
    inside = alphas[(alphas > low + 1e-6) & (alphas < high - 1e-6)]
    machs = nodes_of(vehicle.tables, "mach")
    return machs[machs >= LEAST_MACH], np.array([low, *inside, high])


def polar(vehicle: Vehicle, mach: Any, alpha: Any, **angles: Any) -> Floats:
    """Return the six coefficients of the vehicle's tables at the angles."""
    mass = vehicle.constants.mass_start
    variables = make_variables(vehicle, mach=mach, angle_of_attack=alpha, mass=mass, **angles)
    return evaluate_coefficients(vehicle, variables, rows=table_rows(vehicle.tables, variables))


def push_most(vehicle: Vehicle) -> float:
    """Return the largest coefficient of force along the velocity, over sideslip and deflections."""
    machs, alphas = nodes_within(vehicle)
    signs = np.array([-DEFLECTION, DEFLECTION])
    grid = np.meshgrid(machs, alphas, SIDESLIPS, signs, signs, indexing="ij")
    mach, alpha, beta, aileron, rudder = (x.ravel() for x in grid)
    coefficients = polar(vehicle, mach, alpha, sideslip=beta, aileron=aileron, rudder=rudder)
    return float((coefficients[2] * np.sin(beta) - coefficients[1] * np.cos(beta)).max())


def dutch_roll_ratio(vehicle: Vehicle, alpha: float, elevator: float, eta: float) -> float:
    """Return |bank/sideslip| of the oscillatory lateral mode; infinite if there is none."""
    nominal = Nominal(
        AROUND,
        mass=vehicle.constants.mass_start,
        speed=SPEED,
        flight_path_angle=0.0,
        heading=S.start.heading,
        angle_of_attack=alpha,
        bank=0.0,
        equivalence_ratio=eta,
        elevator=elevator,
    )
    lateral = [1, 2, 3, 5]
    matrix = attitude_slopes(vehicle, nominal)[np.ix_(lateral, lateral)]
    values, vectors = np.linalg.eig(matrix)
    fastest = int(np.argmax(values.imag))
    if values[fastest].imag <= 0.0:
        return float("inf")
    return float(abs(vectors[1, fastest] / vectors[0, fastest]))


def measure(vehicle: Vehicle, alpha: float, elevator: float, eta: float) -> dict[str, float]:
    """Return the traits of SIDES of a vehicle with a known trim."""
    c = vehicle.constants
    machs, alphas = nodes_within(vehicle)
    slope, powers = slopes_at(vehicle, alpha, elevator), control_powers(vehicle, alpha, elevator)
    lift_slope, rudder_arm = slope["CL", "alpha"], powers["rudder arm over the span"]
    state = np.zeros((len(_STATES), 1))
    state[0], state[-1] = alpha, elevator
    lift, drag = coefficients_at(vehicle, AROUND, state)[:2, 0]

    # The polar at the Mach number of the S: CD0 and k of CD0 + k |CL tan(alpha - alpha_0)|.
    lifts, drags = polar(vehicle, MACH, alphas)[:2]
    straight = alphas < np.deg2rad(10.0)
    rise, offset = np.polyfit(alphas[straight], lifts[straight], 1)
    induced = np.abs(lifts * np.tan(alphas + offset / rise))
    factor, _ = np.polyfit(induced, drags, 1)

    mach, angle = (x.ravel() for x in np.meshgrid(machs, alphas, indexing="ij"))
    all_lifts, all_drags = polar(vehicle, mach, angle)[:2]
    ratios = all_lifts / all_drags * mach / (4.0 * (mach + 3.0))

    middles = 0.5 * (alphas[1:] + alphas[:-1])
    cells = [slopes_at(vehicle, middle, elevator) for middle in middles]
    margins = [-100.0 * cell["Cm", "alpha"] / cell["CL", "alpha"] for cell in cells]

    dynamic_pressure = 0.5 * AROUND.density * SPEED**2
    thrust = dynamic_pressure * c.area * drag / np.cos(alpha)
    return {
        "drag_least": float(all_drags.min()),
        "push_most": push_most(vehicle),
        "lift_to_drag": float(lift / drag),
        "kuechemann": float(ratios.max()),
        "induced_drag": float(factor),
        "thrust_to_weight": float(thrust / (c.mass_start * GRAVITY)),
        "wing_loading": c.mass_start / c.area,
        "lift_slope": lift_slope / _ghames_lift_slope(),
        "margin_least": min(margins),
        "margin_most": max(margins),
        "side_slope": slope["CY", "beta"] / lift_slope,
        "roll_damping": slope["Cl", "p"] / lift_slope,
        "pitch_damping": slope["Cm", "q"],
        "damping_radius": powers["radius of pitch damping over the chord"] * BASE.constants.chord,
        "yaw_damping": slope["Cn", "r"],
        # At the rudder, a yaw rate r adds r arm/V to the sideslip.
        "rudder_damping": 2.0 * slope["Cn", "rudder"] * rudder_arm / slope["Cn", "r"],
        "rudder_arm": rudder_arm * BASE.constants.span,
        "rudder_height": slope["Cl", "rudder"] / slope["CY", "rudder"],
        "elevator_arm": powers["elevator arm over the chord"] * BASE.constants.chord,
        "dutch_roll": dutch_roll_ratio(vehicle, alpha, elevator, eta),
    }


def control_powers(vehicle: Vehicle, alpha: float, elevator: float) -> dict[str, float]:
    """Return derivatives of surfaces and sideslip (per rad), arms, damping radius and steady roll.

    The radius of pitch damping is the distance from the centre of gravity at which quasi-steady
    lift has the vehicle's Cm_q: Cm_q = -2 CL_alpha (radius / chord)^2.
    """
    slope = slopes_at(vehicle, alpha, elevator)
    rudder_arm = -slope["Cn", "rudder"] / slope["CY", "rudder"]
    elevator_arm = -slope["Cm", "elevator"] / slope["CL", "elevator"]
    radius = np.sqrt(-slope["Cm", "q"] / (2.0 * slope["CL", "alpha"]))
    roll = -slope["Cl", "aileron"] / slope["Cl", "p"] * DEFLECTION
    return {
        "Cl_da": slope["Cl", "aileron"],
        "CL_de": slope["CL", "elevator"],
        "Cm_de": slope["Cm", "elevator"],
        "CY_dr": slope["CY", "rudder"],
        "Cn_dr": slope["Cn", "rudder"],
        "steady roll p b/2V at 20 deg of aileron": roll,
        "rudder arm over the span": rudder_arm,
        "elevator arm over the chord": elevator_arm,
        "radius of pitch damping over the chord": float(radius),
        "Cl_beta": slope["Cl", "beta"],
    }


@cache
def _ghames_lift_slope() -> float:
    """Return CL_alpha of GHAME in the S, at its trim."""
    ghame = load_vehicle(ROOT / "configs/vehicle/ghame_x.yaml")
    return slopes_at(ghame, *find_trim(ghame)[:2])["CL", "alpha"]


def find_trim(vehicle: Vehicle) -> tuple[float, float, float]:
    """Return angle of attack (rad), elevator (rad) and equivalence ratio at 1 g in the S."""
    point = FlightPoint(20e3, SPEED, latitude=S.start.latitude, heading=S.start.heading)
    point_trim = trim(vehicle, STILL, point)
    if point_trim.fault:
        raise SystemExit(point_trim.fault)
    return point_trim.angle_of_attack, point_trim.elevator, point_trim.equivalence_ratio


def excesses(traits: dict[str, float], inner: float = 0.0) -> Floats:
    """Return the excess of each trait in units over its interval, shortened by `inner`."""
    return np.array([side.excess(traits[name], inner) for name, side in SIDES.items()])


def table(traits: dict[str, dict[str, str]], sides: dict[str, Side] | None = None) -> Iterator[str]:
    """Yield the rows of a Markdown table with each trait as text of each vehicle and its side."""
    yield "| trait | limits | " + " | ".join(traits) + " |"
    yield "|" + "---|" * (2 + len(traits))
    for name, side in (sides or SIDES).items():
        cells = [vehicle_traits[name] for vehicle_traits in traits.values()]
        ends = [f"{end:g}" for end in (side.low, side.high) if np.isfinite(end)]
        sign = "at least " if side.high == INFINITY else "at most " if len(ends) == 1 else ""
        yield f"| {side.label} | {sign}{' to '.join(ends)} | " + " | ".join(cells) + " |"


def shown(traits: dict[str, float]) -> dict[str, str]:
    """Return the traits of a vehicle as text with three digits."""
    return {name: f"{value:.3g}" for name, value in traits.items()}


def main() -> None:
    """Print the traits."""
    parser = argparse.ArgumentParser(description="Print the traits of vehicles beside their sides.")
    parser.add_argument("--smoke", action="store_true", help="only of abhv")
    names = ("abhv",) if parser.parse_args().smoke else ("abhv", "ghame", "winged_cone")
    vehicles = {name: load_vehicle(ROOT / f"configs/vehicle/{name}.yaml") for name in names}
    file = ROOT / "studies/paper_vehicle.json"
    members = json.loads(file.read_text(encoding="utf-8"))["ensemble"] if len(names) > 1 else ()
    for member in members:
        vehicles[member["name"]] = make_vehicle(member["values"])
    traits = {name: shown(measure(v, *find_trim(v))) for name, v in vehicles.items()}
    print(*table(traits), sep="\n")


if __name__ == "__main__":
    main()
