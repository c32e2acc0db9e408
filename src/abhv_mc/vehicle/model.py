"""A vehicle as the compiled plant sees it: packed tables and constants, nothing about any one vehicle."""

import math
from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats, Ints
from abhv_mc.vehicle.arrays import BuildUp, Tables
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


class Vehicle(NamedTuple):
    """The packed vehicle."""

    constants: Constants
    tables: Tables
    build_up: BuildUp
    effector_mix: Floats  # [4, 3] radians of effector per radian of (aileron, rudder, elevator)
    foreign: Foreign = no_functions()
