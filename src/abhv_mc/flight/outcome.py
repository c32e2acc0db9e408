"""Every way a flight can end: a code and a sentence."""

from enum import IntEnum


class Outcome(IntEnum):
    """How a flight ended; the name in lower case is the code in the files."""

    OK = 0
    ALTITUDE_LIMIT = 1
    ANGLE_OF_ATTACK_LIMIT = 2
    SIDESLIP_LIMIT = 3
    NOT_FINITE = 4
    FAILED_TO_RUN = 5

    @property
    def code(self) -> str:
        """The word stored in the Parquet column ``outcome``."""
        return self.name.lower()


SENTENCES: dict[Outcome, str] = {
    Outcome.OK: "The flight reached the end of the mission.",
    Outcome.ALTITUDE_LIMIT: "The altitude left the mission's limits.",
    Outcome.ANGLE_OF_ATTACK_LIMIT: "The angle of attack left the vehicle's limits.",
    Outcome.SIDESLIP_LIMIT: "The sideslip left the vehicle's limits.",
    Outcome.NOT_FINITE: "A state was no longer a finite number.",
    Outcome.FAILED_TO_RUN: "The flight could not be computed on this machine (crash or time limit).",
}
