"""What a vehicle file and a mission file may both say: limits, and what instruments measure angles and speed against.

Bank, flight path angle and heading are always relative to the Earth.
"""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from abhv_mc.io.documents import Refusal, StrictModel
from abhv_mc.io.units import Angle, HeatFlux, Pressure
from abhv_mc.kernel.plant.vehicle import LoadBounds, Sensing

Positive = Field(gt=0.0)


def _check_rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise Refusal(f"an empty range from {ends[0]:g} to {ends[1]:g}", "least and greatest")
    return ends


Rising = AfterValidator(_check_rising)  # of two ends
Range = Annotated[tuple[float, float], Rising]
AngleRange = Annotated[tuple[Angle, Angle], Rising]
STILL_AIR = "still air and no noise: they swing an angle where nothing cycles"


class Oscillation(StrictModel):
    """Greatest ripple of each angle."""

    bank: Annotated[Angle, Positive] | None = Field(None, description="greatest ripple of the bank")
    angle_of_attack: Annotated[Angle, Positive] | None = Field(
        None, description="greatest ripple of the angle of attack"
    )
    sideslip: Annotated[Angle, Positive] | None = Field(
        None, description="greatest ripple of the sideslip"
    )


def _oscillation(value: Any) -> Any:
    return (
        dict.fromkeys(Oscillation.model_fields, value)
        if isinstance(value, str | int | float)
        else value
    )


class LoadLimits(StrictModel):
    """A flight ends above; left out: no limit."""

    dynamic_pressure: Annotated[Pressure, Positive] | None = Field(
        None, description="greatest dynamic pressure"
    )
    load_factor: Annotated[float, Positive] | None = Field(
        default=None, description="magnitude of the specific force, in g: a plain number"
    )
    heat_flux: Annotated[HeatFlux, Positive] | None = Field(
        default=None,
        description="at the stagnation point; needs the vehicle's reference.nose_radius",
    )
    bank: Annotated[Angle, Positive] | None = Field(
        default=None, description="about the velocity, to either side"
    )
    oscillation: (
        Annotated[
            Oscillation, BeforeValidator(_oscillation, json_schema_input_type=Angle | Oscillation)
        ]
        | None
    ) = Field(
        default=None,
        description="greatest ripple: an angle for bank, angle of attack and sideslip, or each",
    )

    def bounds(self) -> LoadBounds:
        """The limits as numbers."""
        ripple = self.oscillation or Oscillation()
        given = (
            self.dynamic_pressure,
            self.load_factor,
            self.heat_flux,
            self.bank,
            ripple.bank,
            ripple.angle_of_attack,
            ripple.sideslip,
        )
        return LoadBounds(*(math.inf if value is None else value for value in given))


def tighter(one: LoadBounds, other: LoadBounds) -> LoadBounds:
    """The smaller of two bounds, each."""
    return LoadBounds(*map(min, one, other))


def refuse_oscillation(loads: LoadBounds, disturbances: Sequence[str]) -> str:
    """Why a flight with these gusts, turbulence or noise has no limit on oscillation; '' where it may."""
    limited = min(loads.bank_ripple, loads.angle_of_attack_ripple, loads.sideslip_ripple) < math.inf
    return f"'{disturbances[0]}' with 'limits: {{oscillation}}'" if limited and disturbances else ""


IN_WIND = "in this wind"  # begins the sentence that says what is measured
Against = Literal["air", "inertial"]


class SensingKeys(StrictModel):
    """What instruments measure: air, or inertial (relative to the Earth)."""

    angle_of_attack: Against | None = Field(
        None, description="air, or inertial, which is the default"
    )
    sideslip: Against | None = Field(None, description="air, or inertial, which is the default")
    airspeed: Against | None = Field(
        None,
        description="air: the measured speed is the airspeed; inertial, the default: the speed over the Earth",
    )


def choose_sensing(mission: SensingKeys, vehicle: Sensing) -> Sensing:
    """What the mission says, and where it says nothing the vehicle."""
    asked = (mission.angle_of_attack, mission.sideslip, mission.airspeed)
    return Sensing(
        *(of if key is None else int(key == "air") for key, of in zip(asked, vehicle, strict=True))
    )


def describe_sensing(sensing: Sensing) -> str:
    """What is measured against what, for a reader."""
    air = [name.replace("_", " ") for name, of in sensing._asdict().items() if of]
    ground = [name.replace("_", " ") for name, of in sensing._asdict().items() if not of]
    found = [
        f"{', '.join(of)} relative to {what}"
        for of, what in ((air, "the air"), (ground, "the Earth"))
        if of
    ]
    return "the controllers are given " + " and ".join(found)
