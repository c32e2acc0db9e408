"""Limits on loads, heat, bank and oscillation: what a vehicle file and a mission file may both name."""

import math
from collections.abc import Sequence
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from abhv_mc.io.documents import StrictModel
from abhv_mc.io.units import Angle, HeatFlux, Pressure
from abhv_mc.kernel.plant.vehicle import LoadBounds

Positive = Field(gt=0.0)
STILL_AIR = "still air and no noise: they swing an angle where nothing cycles"


class Oscillation(StrictModel):
    """Greatest ripple of each angle."""

    bank: Annotated[Angle, Positive] | None = Field(None, description="greatest ripple of the bank")
    angle_of_attack: Annotated[Angle, Positive] | None = Field(
        None, description="greatest ripple of the angle of attack"
    )
    sideslip: Annotated[Angle, Positive] | None = Field(None, description="greatest ripple of the sideslip")


def _oscillation(value: Any) -> Any:
    return dict.fromkeys(Oscillation.model_fields, value) if isinstance(value, str | int | float) else value


class LoadLimits(StrictModel):
    """A flight ends above; left out: no limit."""

    dynamic_pressure: Annotated[Pressure, Positive] | None = Field(None, description="greatest dynamic pressure")
    load_factor: Annotated[float, Positive] | None = Field(
        default=None, description="magnitude of the specific force, in g: a plain number"
    )
    heat_flux: Annotated[HeatFlux, Positive] | None = Field(
        default=None, description="at the stagnation point; needs the vehicle's reference.nose_radius"
    )
    bank: Annotated[Angle, Positive] | None = Field(default=None, description="about the velocity, to either side")
    oscillation: (
        Annotated[Oscillation, BeforeValidator(_oscillation, json_schema_input_type=Angle | Oscillation)] | None
    ) = Field(default=None, description="greatest ripple: an angle for bank, angle of attack and sideslip, or each")

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
