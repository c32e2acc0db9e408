"""What instruments measure angles and speed against: the ground, as the paper's do, or the air.

Bank, flight path angle and heading are always relative to the Earth.
"""

from typing import Literal

from pydantic import Field

from abhv_mc.io.documents import StrictModel
from abhv_mc.kernel.plant.vehicle import Sensing

IN_WIND = "in this wind"  # begins the sentence that says what is measured
Against = Literal["air", "inertial"]


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


def describe_sensing(sensing: Sensing) -> str:
    """What is measured against what, for a reader."""
    air = [name.replace("_", " ") for name, of in sensing._asdict().items() if of]
    ground = [name.replace("_", " ") for name, of in sensing._asdict().items() if not of]
    found = [f"{', '.join(of)} relative to {what}" for of, what in ((air, "the air"), (ground, "the Earth")) if of]
    return "the controllers are given " + " and ".join(found)
