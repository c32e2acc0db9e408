"""Every way a flight can end: a code and a sentence, and the limits that end it early."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple


class Outcome(IntEnum):
    """How a flight ended; the name in lower case is the code in the files."""

    OK = 0
    ALTITUDE_LIMIT = 1
    ANGLE_OF_ATTACK_LIMIT = 2
    SIDESLIP_LIMIT = 3
    NOT_FINITE = 4
    FAILED_TO_RUN = 5
    LAW_FAILED = 50

    @property
    def code(self) -> str:
        """The word stored in the Parquet column ``outcome``."""
        return self.name.lower()


SENTENCES: dict[Outcome, str] = {
    Outcome.OK: "The flight reached the end of the mission.",
    Outcome.ALTITUDE_LIMIT: "The altitude left the mission's limits.",
    Outcome.ANGLE_OF_ATTACK_LIMIT: "The angle of attack left the vehicle's limits.",
    Outcome.SIDESLIP_LIMIT: "The sideslip left the vehicle's limits.",
    Outcome.NOT_FINITE: "A state or a command was no longer a finite number.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed on this machine (crash or time limit).",
    Outcome.LAW_FAILED: "The control law, one of the user's own, raised an exception.",
}


class Limits(NamedTuple):
    """Where a flight ends, SI and radians."""

    altitude_min: float
    altitude_max: float
    angle_of_attack_min: float
    angle_of_attack_max: float
    sideslip_max: float


@dataclass(frozen=True)
class Limit:
    """A flight ends with ``outcome`` where ``source`` (see :mod:`abhv_mc.flight.signals`) leaves its two bounds."""

    outcome: Outcome
    source: str
    bounds: Callable[[Limits], tuple[float, float]]


# Of two limits left at the same tick the later one in this table names the outcome.
LIMITS: tuple[Limit, ...] = (
    Limit(Outcome.SIDESLIP_LIMIT, "sideslip", lambda limits: (-limits.sideslip_max, limits.sideslip_max)),
    Limit(
        Outcome.ANGLE_OF_ATTACK_LIMIT,
        "angle_of_attack",
        lambda limits: (limits.angle_of_attack_min, limits.angle_of_attack_max),
    ),
    Limit(Outcome.ALTITUDE_LIMIT, "altitude", lambda limits: (limits.altitude_min, limits.altitude_max)),
)
