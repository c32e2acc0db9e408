"""Every way a flight can end: a code and a sentence, and the limits that end it early."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.kernel.laws import user
from abhv_mc.kernel.plant.vehicle import LoadBounds


class Outcome(IntEnum):
    """How a flight ended; the name in lower case is the code in the files."""

    OK = 0
    ALTITUDE_LIMIT = 1
    ANGLE_OF_ATTACK_LIMIT = 2
    SIDESLIP_LIMIT = 3
    NOT_FINITE = int(user.NOT_FINITE)  # the kernel's
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
    LAW_FAILED = 50
    LAW_CRASHED = 51
    LAW_HUNG = 52

    @property
    def code(self) -> str:
        """The word stored in the Parquet column ``outcome``."""
        return self.name.lower()


@dataclass(frozen=True)
class Outcomes:
    """The ways in which a campaign's flights may end: number, code and sentence of each."""

    codes: Mapping[int, str]
    sentences: Mapping[str, str]

    @cached_property
    def numbers(self) -> Mapping[str, int]:
        return {code: number for number, code in self.codes.items()}

    def of(self, numbers: NDArray[np.int64]) -> tuple[str, ...]:
        """The codes [flight] of numbers."""
        return tuple(map(self.codes.__getitem__, numbers.tolist()))


LAW_LOST = (
    Outcome.LAW_CRASHED,
    Outcome.LAW_HUNG,
)  # they count as a failed law does, and have no metrics


def find_lost_outcome(law: str, hung: bool) -> Outcome:
    """The outcome of a flight whose process was lost with it alone, twice: the law's where that is native code."""
    if law not in ("c", "fmu"):
        return Outcome.FAILED_TO_RUN
    return Outcome.LAW_HUNG if hung else Outcome.LAW_CRASHED


SENTENCES: dict[Outcome, str] = {
    Outcome.OK: "The flight reached the end of the mission.",
    Outcome.ALTITUDE_LIMIT: "The altitude left the mission's limits.",
    Outcome.ANGLE_OF_ATTACK_LIMIT: "The angle of attack left the vehicle's limits.",
    Outcome.SIDESLIP_LIMIT: "The sideslip left the vehicle's limits.",
    Outcome.NOT_FINITE: "A state or a command was no longer a finite number.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed on this machine (crash or time limit).",
    Outcome.DYNAMIC_PRESSURE_LIMIT: "The dynamic pressure exceeded the limit of the mission or the vehicle.",
    Outcome.LOAD_FACTOR_LIMIT: "The load factor exceeded the limit of the mission or the vehicle.",
    Outcome.HEAT_FLUX_LIMIT: "The stagnation heat flux exceeded the limit of the mission or the vehicle.",
    Outcome.BANK_LIMIT: "The bank exceeded the limit of the mission or the vehicle.",
    Outcome.OSCILLATION_LIMIT: "An angle oscillated by more than the limit of the mission or the vehicle.",
    Outcome.FUEL_OUT: "The fuel was burnt before the end of the mission.",
    Outcome.POLE_LIMIT: "The flight came nearer to a pole than the model can follow its longitude and heading.",
    Outcome.SPEED_LIMIT: "The speed exceeded the mission's limit, by default twice the largest of its reference.",
    Outcome.STATE_LIMIT: "A state of the vehicle's custom dynamics exceeded its limit.",
    Outcome.LAW_FAILED: "The control law, one of the user's own, raised an exception or returned an error.",
    Outcome.LAW_CRASHED: "The control law, one of the user's own, ended its process (a crash), twice.",
    Outcome.LAW_HUNG: "The control law, one of the user's own, did not return in time, twice.",
}


_OF_A_SIMULATOR = {
    Outcome.OK: "The flight reached its end.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed (a crash, the time limit, or no answer that counts).",
}
_FIRST_DECLARED = 100  # number of the first outcome that a user's simulator declares
OUTCOMES = Outcomes(
    {int(o): o.code for o in Outcome}, {o.code: words for o, words in SENTENCES.items()}
)


def simulator_outcomes(declared: Mapping[str, str]) -> Outcomes:
    """The outcomes of a user's simulator, whose own have a code and a sentence each."""
    codes = {int(o): o.code for o in _OF_A_SIMULATOR} | dict(enumerate(declared, _FIRST_DECLARED))
    return Outcomes(codes, {o.code: words for o, words in _OF_A_SIMULATOR.items()} | dict(declared))


class EndBounds(NamedTuple):
    """Ranges within which the mission goes on, SI and radians; a flight that leaves one has flown it."""

    altitude: tuple[float, float] = (-math.inf, math.inf)
    speed: tuple[float, float] = (-math.inf, math.inf)
    mach: tuple[float, float] = (-math.inf, math.inf)
    dynamic_pressure: tuple[float, float] = (-math.inf, math.inf)
    flight_path_angle: tuple[float, float] = (-math.inf, math.inf)
    mass: tuple[float, float] = (-math.inf, math.inf)


class Limits(NamedTuple):
    """Where a flight ends, SI and radians."""

    altitude_min: float
    altitude_max: float
    angle_of_attack_min: float
    angle_of_attack_max: float
    sideslip_max: float
    loads: LoadBounds = LoadBounds()
    end: EndBounds = EndBounds()
    fuel_min: float = -math.inf  # kg
    speed_max: float = math.inf


@dataclass(frozen=True)
class Limit:
    """A flight ends with ``outcome`` where ``source`` (see :mod:`abhv_mc.flight.channels`) leaves its two bounds."""

    outcome: Outcome
    source: str
    bounds: Callable[[Limits], tuple[float, float]]


_SOURCES = {
    "dynamic_pressure": "q_bar",
    "flight_path_angle": "gamma",
}  # where the lane memory calls it so


def _end(name: str) -> Limit:
    """A range of :class:`EndBounds`."""
    return Limit(Outcome.OK, _SOURCES.get(name, name), lambda limits: getattr(limits.end, name))


NEAREST_POLE = math.radians(
    89.995
)  # latitude; 560 m from the pole Mach 10 turns 0.05 rad a step about it
_RIPPLES = ("bank_ripple", "angle_of_attack_ripple", "sideslip_ripple")
_DEG = 180.0 / math.pi


def _above(outcome: Outcome, source: str, name: str, factor: float = 1.0) -> Limit:
    """A limit of :class:`LoadBounds`, ``factor`` to the source's unit."""
    return Limit(outcome, source, lambda limits: (-math.inf, factor * getattr(limits.loads, name)))


# Of two limits left at the same tick the later one in this table names the outcome.
LIMITS: tuple[Limit, ...] = (
    Limit(Outcome.POLE_LIMIT, "latitude", lambda limits: (-NEAREST_POLE, NEAREST_POLE)),
    Limit(Outcome.FUEL_OUT, "fuel_left_kg", lambda limits: (limits.fuel_min, math.inf)),
    *map(_end, EndBounds._fields),
    *(_above(Outcome.OSCILLATION_LIMIT, f"{name}_deg", name, _DEG) for name in _RIPPLES),
    Limit(Outcome.BANK_LIMIT, "bank", lambda limits: (-limits.loads.bank, limits.loads.bank)),
    Limit(Outcome.SPEED_LIMIT, "speed", lambda limits: (-math.inf, limits.speed_max)),
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
