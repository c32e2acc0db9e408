"""Outcomes of flights, with codes and sentences."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

from abhv_mc.array_types import Ints


class Outcome(IntEnum):
    """Outcome of a flight; files contain its name in lower case as a code."""

    OK = 0
    ALTITUDE_LIMIT = 1
    ANGLE_OF_ATTACK_LIMIT = 2
    SIDESLIP_LIMIT = 3
    NOT_FINITE = 4  # abhv_mc_vehicle.kernel.laws.user.NOT_FINITE
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

    def of(self, numbers: Ints) -> tuple[str, ...]:
        """Return the codes [flight] for outcome numbers [flight]."""
        return tuple(map(self.codes.__getitem__, numbers.tolist()))


# These outcomes count like LAW_FAILED, but their flights have no metrics.
LAW_LOST = (
    Outcome.LAW_CRASHED,
    Outcome.LAW_HUNG,
)
SENTENCES = {
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
