"""Outcomes of flights, with codes and sentences, and limits that terminate flights early."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.kernel.plant.vehicle import LoadBounds


class Outcome(IntEnum):
    """Outcome of a flight; files contain its name in lower case as a code."""

    OK = 0
    ALTITUDE_LIMIT = 1
    ANGLE_OF_ATTACK_LIMIT = 2
    SIDESLIP_LIMIT = 3
    NOT_FINITE = 4  # abhv_mc.kernel.laws.user.NOT_FINITE
    FAILED_TO_RUN = 5
    DYNAMIC_PRESSURE_LIMIT = 6
    LOAD_FACTOR_LIMIT = 7
    HEAT_FLUX_LIMIT = 8
    BANK_LIMIT = 9
    OSCILLATION_LIMIT = 10
    FUEL_OUT = 11
    POLE_LIMIT = 12
    SPEED_LIMIT = 13
    STATE_LIMIT = 14
    MACH_LIMIT = 15
    LAW_FAILED = 50
    LAW_CRASHED = 51
    LAW_HUNG = 52

    @property
    def code(self) -> str:
        """Text in the Parquet column ``outcome``."""
        return self.name.lower()


@dataclass(frozen=True)
class Outcomes:
    """Possible outcomes of flights, each with number, code and sentence."""

    codes: Mapping[int, str]
    sentences: Mapping[str, str]

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        return {code: number for number, code in self.codes.items()}

    def of(self, numbers: NDArray[np.int64]) -> tuple[str, ...]:
        """Return the codes [flight] for outcome numbers [flight]."""
        return tuple(map(self.codes.__getitem__, numbers.tolist()))


# These outcomes count like LAW_FAILED, but their flights have no metrics.
LAW_LOST = (
    Outcome.LAW_CRASHED,
    Outcome.LAW_HUNG,
)


SENTENCES: dict[Outcome, str] = {
    Outcome.OK: "The flight reached the end of the mission.",
    Outcome.ALTITUDE_LIMIT: "The altitude left the limits of the mission or the vehicle.",
    Outcome.ANGLE_OF_ATTACK_LIMIT: "The angle of attack left the vehicle's limits.",
    Outcome.SIDESLIP_LIMIT: "The sideslip left the vehicle's limits.",
    Outcome.NOT_FINITE: "A state or a command was no longer a finite number.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed on this machine (crash or time "
    "limit).",
    Outcome.DYNAMIC_PRESSURE_LIMIT: "The dynamic pressure exceeded the limit of the mission or the "
    "vehicle.",
    Outcome.LOAD_FACTOR_LIMIT: "The load factor exceeded the limit of the mission or the vehicle.",
    Outcome.HEAT_FLUX_LIMIT: "The stagnation heat flux exceeded the limit of the mission or the "
    "vehicle.",
    Outcome.BANK_LIMIT: "The bank exceeded the limit of the mission or the vehicle.",
    Outcome.OSCILLATION_LIMIT: "An angle oscillated by more than the limit of the mission or the "
    "vehicle.",
    Outcome.FUEL_OUT: "The fuel was burnt before the end of the mission.",
    Outcome.POLE_LIMIT: "The flight came too close to a pole for the model's longitude and heading "
    "to be accurate.",
    Outcome.SPEED_LIMIT: "The speed exceeded the mission's limit, by default twice the largest "
    "reference speed.",
    Outcome.STATE_LIMIT: "A state of the vehicle's custom dynamics exceeded its limit.",
    Outcome.MACH_LIMIT: "The Mach number left the vehicle's limits.",
    Outcome.LAW_FAILED: "The custom control law raised an exception or returned an error.",
    Outcome.LAW_CRASHED: "The process of the custom control law ended.",
    Outcome.LAW_HUNG: "The custom control law exceeded its time limit.",
}


_OF_A_SIMULATOR = {
    Outcome.OK: "The flight reached its end.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed (crash, time limit, or invalid "
    "output).",
}
_FIRST_DECLARED = 100  # number of the first outcome that a custom simulator declares
OUTCOMES = Outcomes(
    {int(o): o.code for o in Outcome}, {o.code: sentence for o, sentence in SENTENCES.items()}
)


def simulator_outcomes(declared: Mapping[str, str]) -> Outcomes:
    """Return the outcomes of a custom simulator, including declared outcomes."""
    codes = {int(o): o.code for o in _OF_A_SIMULATOR} | dict(enumerate(declared, _FIRST_DECLARED))
    return Outcomes(
        codes, {o.code: sentence for o, sentence in _OF_A_SIMULATOR.items()} | dict(declared)
    )


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

    Sources are defined in :mod:`abhv_mc.flight.channels`.
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
