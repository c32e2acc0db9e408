"""Keys shared by vehicle and mission files: limits, and the reference for measurements.

Quantities are measured relative to the air or to the Earth. Bank, flight path angle and heading are
always relative to the Earth.
"""

import contextlib
import math
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field

from abhv_mc.io.documents import StrictModel
from abhv_mc.io.messages import Refusal
from abhv_mc.io.units import Angle, HeatFlux, Pressure
from abhv_mc_vehicle.kernel.plant.vehicle import LoadBounds, Sensing

Positive = Field(gt=0.0)


@contextlib.contextmanager
def located(*keys: str | int) -> Iterator[None]:
    """Set ``keys`` as the location of each Refusal raised inside the context."""
    try:
        yield
    except Refusal as refusal:
        raise Refusal(refusal.found, refusal.expected, keys) from None


def _check_rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise Refusal(
            f"the range from {ends[0]:g} to {ends[1]:g} is empty", "a minimum below the maximum"
        )
    return ends


Rising = AfterValidator(_check_rising)  # validator of a (minimum, maximum) pair
Range = Annotated[tuple[float, float], Rising]
AngleRange = Annotated[tuple[Angle, Angle], Rising]
STILL_AIR = "still air and no noise, because gusts and noise cause ripple without a limit cycle"


class Oscillation(StrictModel):
    """Maximum oscillation (ripple) of each angle; a larger oscillation ends a flight."""

    bank: Annotated[Angle, Positive] | None = None
    """maximum peak-to-peak amplitude of oscillations of the bank error"""
    angle_of_attack: Annotated[Angle, Positive] | None = None
    """maximum peak-to-peak amplitude of oscillations of the angle-of-attack error"""
    sideslip: Annotated[Angle, Positive] | None = None
    """maximum peak-to-peak amplitude of oscillations of the sideslip"""


def _oscillation(value: Any) -> Any:
    return (
        dict.fromkeys(Oscillation.model_fields, value)
        if isinstance(value, str | int | float)
        else value
    )


class LoadLimits(StrictModel):
    """Load limits; a flight that exceeds a limit ends. By default there are no limits."""

    dynamic_pressure: Annotated[Pressure, Positive] | None = None
    """maximum dynamic pressure"""
    load_factor: Annotated[float, Positive] | None = None
    """maximum magnitude of the specific force, in g, as a plain number"""
    heat_flux: Annotated[HeatFlux, Positive] | None = None
    """maximum heat flux at the stagnation point; requires reference.nose_radius in the vehicle
    file"""
    bank: Annotated[Angle, Positive] | None = None
    """maximum bank angle about the velocity, in either direction"""
    oscillation: (
        Annotated[
            Oscillation, BeforeValidator(_oscillation, json_schema_input_type=Angle | Oscillation)
        ]
        | None
    ) = None
    """maximum ripple of bank, angle of attack and sideslip: one value, or a value per angle"""

    def bounds(self) -> LoadBounds:
        """Return the limits as numbers for the kernel."""
        ripple = self.oscillation or Oscillation()
        limits = (
            self.dynamic_pressure,
            self.load_factor,
            self.heat_flux,
            self.bank,
            ripple.bank,
            ripple.angle_of_attack,
            ripple.sideslip,
        )
        return LoadBounds(*(math.inf if value is None else value for value in limits))


def oscillation_conflict(loads: LoadBounds, disturbances: Sequence[str]) -> str:
    """Describe the conflict of an oscillation limit with gusts or noise, or return ''."""
    limited = min(loads.bank_ripple, loads.angle_of_attack_ripple, loads.sideslip_ripple) < math.inf
    return (
        f"'{disturbances[0]}' conflicts with 'limits: {{oscillation}}'"
        if limited and disturbances
        else ""
    )


IN_WIND = "in this wind"  # beginning of the sentence about measured quantities
Against = Literal["air", "inertial"]


class SensingKeys(StrictModel):
    """Reference of measured quantities: the air, or the Earth ("inertial")."""

    angle_of_attack: Against | None = None
    """reference for the measured angle of attack: air, or inertial (default)"""
    sideslip: Against | None = None
    """reference for the measured sideslip: air, or inertial (default)"""
    airspeed: Against | None = None
    """reference for the measured speed: air, or inertial (default: speed relative to the Earth)"""


def choose_sensing(mission: SensingKeys, vehicle: Sensing) -> Sensing:
    """Return the mission's references for measurements, by default those of the vehicle."""
    return Sensing(
        *(
            default if key is None else int(key == "air")
            for (_, key), default in zip(mission, vehicle, strict=True)
        )
    )


def describe_sensing(sensing: Sensing) -> str:
    """Return a clause that states which measurements are relative to air or Earth."""
    phrases = []
    for reference, value in (("the air", 1), ("the Earth", 0)):
        names = [name.replace("_", " ") for name, own in sensing._asdict().items() if own == value]
        if names:
            phrases.append(f"{', '.join(names)} relative to {reference}")
    return "the controllers receive " + " and ".join(phrases)
