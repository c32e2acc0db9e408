"""What instruments measure angles and speed against: the ground, as the paper's do, or the air.

Bank, flight path angle and heading are always relative to the Earth.
"""

from typing import Literal, NamedTuple

from pydantic import Field

from abhv_mc.io.documents import StrictModel

IN_WIND = "in this wind"  # begins the sentence that says what is measured
Against = Literal["air", "inertial"]


class Sensing(NamedTuple):
    """Which of the measured values are relative to the air: 1, or 0 where to the Earth."""

    angle_of_attack: int = 0
    sideslip: int = 0
    speed: int = 0

    @property
    def words(self) -> str:
        """For a reader."""
        names = ("angle of attack", "sideslip", "speed")
        air = [name for name, of in zip(names, self, strict=True) if of]
        ground = [name for name in names if name not in air]
        found = [f"{', '.join(of)} relative to {what}" for of, what in ((air, "the air"), (ground, "the Earth")) if of]
        return "the controllers are given " + " and ".join(found)


class SensingKeys(StrictModel):
    """What instruments measure: air, or inertial (relative to the Earth)."""

    angle_of_attack: Against | None = Field(None, description="air, or inertial, which is the default")
    sideslip: Against | None = Field(None, description="air, or inertial, which is the default")
    airspeed: Against | None = Field(
        None, description="air: the measured speed is the airspeed; inertial, the default: the speed over the Earth"
    )


def choose_sensing(mission: SensingKeys, vehicle: Sensing) -> Sensing:
    """What the mission says, and where it says nothing the vehicle."""
    asked = (mission.angle_of_attack, mission.sideslip, mission.airspeed)
    return Sensing(*(of if key is None else int(key == "air") for key, of in zip(asked, vehicle, strict=True)))
