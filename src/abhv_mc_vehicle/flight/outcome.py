"""Outcomes of flights, with codes and sentences, and limits that terminate flights early."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from abhv_mc.flights.outcomes import Outcome
from abhv_mc_vehicle.kernel.plant.vehicle import LoadBounds


class EndBounds(NamedTuple):
    """Ranges in SI units and radians; leaving a range completes the mission."""

    altitude: tuple[float, float] = (-math.inf, math.inf)
    speed: tuple[float, float] = (-math.inf, math.inf)
    mach: tuple[float, float] = (-math.inf, math.inf)
    dynamic_pressure: tuple[float, float] = (-math.inf, math.inf)
    flight_path_angle: tuple[float, float] = (-math.inf, math.inf)
    mass: tuple[float, float] = (-math.inf, math.inf)


class Limits(NamedTuple):
    """Limits that end a flight, in SI units and radians."""

    altitude_min: float
    altitude_max: float
    angle_of_attack_min: float
    angle_of_attack_max: float
    sideslip_max: float
    loads: LoadBounds = LoadBounds()
    end: EndBounds = EndBounds()
    fuel_min: float = -math.inf  # minimum mass of fuel, kg
    speed_max: float = math.inf
    mach: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True)
class Limit:
    """Limit that ends a flight with ``outcome`` when ``source`` leaves its bounds.

    Sources are defined in :mod:`abhv_mc_vehicle.flight.channels`.
    """

    outcome: Outcome
    source: str
    bounds: Callable[[Limits], tuple[float, float]]


# Names of quantities in the lane memory, if they differ from the names of the limits.
_SOURCES = {
    "dynamic_pressure": "q_bar",
    "flight_path_angle": "gamma",
}


def _end(name: str) -> Limit:
    """Return the limit for a range of :class:`EndBounds`."""
    return Limit(Outcome.OK, _SOURCES.get(name, name), lambda limits: getattr(limits.end, name))


# Latitude limit 560 m from a pole, where at Mach 10 the longitude changes by 0.05 rad per step.
NEAREST_POLE = math.radians(89.995)
_RIPPLES = ("bank_ripple", "angle_of_attack_ripple", "sideslip_ripple")
_DEG = 180.0 / math.pi


def _above(outcome: Outcome, source: str, name: str, factor: float = 1.0) -> Limit:
    """Return the limit for a field of :class:`LoadBounds`, multiplied by ``factor``."""
    return Limit(outcome, source, lambda limits: (-math.inf, factor * getattr(limits.loads, name)))


# If two limits are exceeded at the same tick, the later entry determines the outcome.
LIMITS: tuple[Limit, ...] = (
    Limit(Outcome.POLE_LIMIT, "latitude", lambda limits: (-NEAREST_POLE, NEAREST_POLE)),
    Limit(Outcome.FUEL_OUT, "fuel_left_kg", lambda limits: (limits.fuel_min, math.inf)),
    *map(_end, EndBounds._fields),
    *(_above(Outcome.OSCILLATION_LIMIT, f"{name}_deg", name, _DEG) for name in _RIPPLES),
    Limit(Outcome.BANK_LIMIT, "bank", lambda limits: (-limits.loads.bank, limits.loads.bank)),
    Limit(Outcome.SPEED_LIMIT, "speed", lambda limits: (-math.inf, limits.speed_max)),
    Limit(Outcome.MACH_LIMIT, "mach", lambda limits: limits.mach),
    _above(Outcome.HEAT_FLUX_LIMIT, "stagnation_heat_flux_w_m2", "heat_flux"),
    _above(Outcome.LOAD_FACTOR_LIMIT, "load_factor_g", "load_factor"),
    _above(Outcome.DYNAMIC_PRESSURE_LIMIT, "q_bar", "dynamic_pressure"),
    Limit(
        Outcome.SIDESLIP_LIMIT,
        "sideslip",
        lambda limits: (-limits.sideslip_max, limits.sideslip_max),
    ),
    Limit(
        Outcome.ANGLE_OF_ATTACK_LIMIT,
        "angle_of_attack",
        lambda limits: (limits.angle_of_attack_min, limits.angle_of_attack_max),
    ),
    Limit(
        Outcome.ALTITUDE_LIMIT,
        "altitude",
        lambda limits: (limits.altitude_min, limits.altitude_max),
    ),
)
