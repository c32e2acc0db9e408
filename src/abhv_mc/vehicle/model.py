"""A vehicle as the compiled plant sees it: packed tables and constants, nothing about any one vehicle."""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.io.input_error import InputError
from abhv_mc.vehicle.arrays import VARIABLES, BuildUp, Tables
from abhv_mc.vehicle.limits import LoadBounds
from abhv_mc.vehicle.sensing import Sensing


class Inlet(NamedTuple):
    """Where the inlet stays started, SI and radians, and what its unstart does besides the loss of thrust."""

    unstarts: float = 0.0  # 1 where the vehicle file has such a range
    angle_of_attack_min: float = -math.inf
    angle_of_attack_max: float = math.inf
    sideslip_max: float = math.inf
    mach_min: float = -math.inf
    mach_max: float = math.inf
    restart_delay: float = math.inf  # s inside the range until it starts again; infinite: never
    drag_increment: float = 0.0
    pitching_moment_increment: float = 0.0


class Foreign(NamedTuple):
    """Functions of the vehicle's own in place of tables; their code is known by its digest."""

    aerodynamics: int  # 1 where they give the coefficients
    propulsion: int  # 1 where they give the thrust
    engine_x: float  # m, where the thrust's moments are given, from the moment reference
    engine_z: float
    digest: Ints  # [4] SHA-256 of the code and of how it is called; zeros without code
    aerodynamics_settings: Floats  # [setting]
    propulsion_settings: Floats


def no_functions() -> Foreign:
    """A vehicle of tables."""
    return Foreign(0, 0, 0.0, 0.0, np.zeros(4, np.int64), np.zeros(1), np.zeros(1))


class Constants(NamedTuple):
    """Numbers of a vehicle, SI and radians."""

    area: float  # reference area, m2
    span: float  # reference span (roll and yaw), m
    chord: float  # reference chord (pitch), m
    capture_thrust: float  # T = capture_thrust * eta * rho * V * ca * Isp: stoichiometric ratio * cowl area * g0
    standard_gravity: float  # g0 of the specific impulse, m/s2: fuel flow = T / (g0 Isp)
    thrust_cos: float  # cosine and sine of the thrust line's upward inclination
    thrust_sin: float
    thrust_offset_z: float  # thrust line below the moment reference, m
    mass_start: float  # kg
    mass_empty: float  # kg: no fuel below it
    burns_fuel: float  # 1, or 0 for a vehicle whose file gives no empty mass: its mass stays and its engine runs
    surface_bandwidth: float  # rad/s, the three axis deflections alike
    surface_damping: float
    surface_limit: float  # rad
    surface_rate_limit: float  # rad/s
    engine_bandwidth: float  # rad/s
    engine_damping: float
    equivalence_ratio_min: float
    equivalence_ratio_max: float
    engine_rate_limit: float  # 1/s
    angle_of_attack_min: float  # rad, a flight ends outside
    angle_of_attack_max: float
    sideslip_max: float
    drag_in_wind_axes: float  # 1: drag opposes the velocity (a sphere); 0: drag and lift in stability axes
    nose_radius: float  # m; 0 where the file has none
    inlet: Inlet
    bounds: LoadBounds  # a flight ends above
    relight_delay: float = 0.0  # s from the end of an engine's failure until it begins to come back
    relight_time_constant: float = 0.0  # s, with which it comes back; 0: the engine's own lag
    sensing: Sensing = Sensing()  # what angles and speed are measured against
    ideal_surfaces: float = 0.0  # 1: deflections are what is commanded
    ideal_engine: float = 0.0


# Columns of ``Vehicle.effectors``: rad, rad, rad/s, rad/s, -, and 1 or 0: moves without dynamics; has an actuator of
# its own, or follows the three axis deflections.
LOW, HIGH, RATE, BANDWIDTH, DAMPING, IDEAL, DRIVEN = range(7)


class Vehicle(NamedTuple):
    """The packed vehicle."""

    constants: Constants
    tables: Tables
    build_up: BuildUp
    effector_mix: Floats  # [effector, 3] radians of effector per radian of (aileron, rudder, elevator)
    effectors: Floats  # [effector, 7] the columns above; of one that is not driven, the surfaces' numbers
    effector_names: Ints  # [effector, letter] code points, zeros behind
    engines: Floats  # [engine, 4] share of the thrust; x, y, z of it from where all of it acts, m; none: one engine
    foreign: Foreign = no_functions()


def name_effectors(vehicle: Vehicle) -> tuple[str, ...]:
    """The names of a vehicle's effectors, in their order."""
    return tuple("".join(map(chr, row[row > 0])) for row in vehicle.effector_names)


def follow_axes(vehicle: Vehicle) -> Vehicle:
    """The vehicle with effectors that follow the axes' deflections."""
    effectors = vehicle.effectors.copy()
    effectors[:, DRIVEN] = 0.0
    return vehicle._replace(effectors=effectors)


def drive_all(vehicle: Vehicle) -> Vehicle:
    """The vehicle with an actuator at each effector: what is not given is the surfaces'."""
    effectors = vehicle.effectors.copy()
    effectors[:, DRIVEN] = 1.0
    return vehicle._replace(effectors=effectors)


def drive_axes(vehicle: Vehicle) -> Vehicle:
    """The vehicle with actuators of the three axis deflections, which move all as its effectors' move, limits apart.

    The effectors follow by their mix. Raises InputError where actuators differ, those of an axis deflection that acts
    itself among them.
    """
    c = vehicle.constants
    driven = vehicle.effectors[:, DRIVEN] > 0.0
    if not driven.any():
        return vehicle
    kinds = vehicle.effectors[driven][:, BANDWIDTH : IDEAL + 1].tolist()
    names = [name for name, own in zip(name_effectors(vehicle), driven, strict=True) if own]
    used = {VARIABLES[i] for i in (*vehicle.build_up.variable, *vehicle.tables.axis_variable)}
    if not driven.all() or used & {"aileron", "rudder", "elevator"}:
        kinds.append([c.surface_bandwidth, c.surface_damping, c.ideal_surfaces])
        names.append("surfaces")
    other = next((i for i, kind in enumerate(kinds) if kind != kinds[0]), None)
    if other is not None:
        found = f"actuators that differ: {names[0]} ({_lag(kinds[0])}), {names[other]} ({_lag(kinds[other])})"
        raise InputError("vehicle", found, "one bandwidth and damping of all surfaces, for a linear model")
    bandwidth, damping, ideal = kinds[0]
    constants = c._replace(surface_bandwidth=bandwidth, surface_damping=damping, ideal_surfaces=ideal)
    return follow_axes(vehicle)._replace(constants=constants)


def _lag(kind: list[float]) -> str:
    bandwidth, damping, ideal = kind
    return "ideal" if ideal else f"{bandwidth:g} rad/s, damping {damping:g}"


def deflection_range(vehicle: Vehicle, axis: int) -> tuple[float, float]:
    """Least and greatest deflection (rad) of aileron, rudder or elevator alone that its effectors can follow."""
    low, high = -vehicle.constants.surface_limit, vehicle.constants.surface_limit
    for mix, effector in zip(vehicle.effector_mix[:, axis], vehicle.effectors, strict=True):
        if effector[DRIVEN] > 0.0 and mix != 0.0:
            ends = sorted((effector[LOW] / mix, effector[HIGH] / mix))
            low, high = max(low, ends[0]), min(high, ends[1])
    return float(low), float(high)
