"""The control surfaces in a vehicle file: actuators of the three axis deflections, and effectors of its own."""

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from abhv_mc.io.documents import Refusal, StrictModel
from abhv_mc.io.units import Angle, AngularRate
from abhv_mc.vehicle.shared_keys import Positive

AXIS_DEFLECTIONS = ("aileron", "rudder", "elevator")


class Effector(StrictModel):
    """One surface: its deflection per deflection of each axis, and its actuator if it has one of its own."""

    aileron: float = Field(0.0, description="deflection per aileron command")
    rudder: float = Field(0.0, description="deflection per rudder command")
    elevator: float = Field(0.0, description="deflection per elevator command")
    limits: tuple[Angle, Angle] | None = Field(default=None, description="least and greatest deflection")
    rate: Annotated[AngularRate, Positive] | None = Field(default=None, description="greatest rate of deflection")
    bandwidth: Annotated[AngularRate, Positive] | None = Field(default=None, description="natural frequency")
    damping: Annotated[float, Positive] | None = Field(default=None, description="damping ratio")
    ideal: bool = Field(False, description="deflections are what is commanded")

    @property
    def driven(self) -> bool:
        """Whether it has an actuator of its own; what that does not say is as ``surfaces`` has it."""
        return bool(self.model_fields_set - set(AXIS_DEFLECTIONS))

    @model_validator(mode="after")
    def _check(self) -> "Effector":
        if self.limits is not None and not self.limits[0] <= 0.0 <= self.limits[1]:
            raise Refusal(f"{list(self.limits)} rad", "least and greatest, about 0", ("limits",))
        if self.ideal and (self.rate or self.bandwidth or self.damping):
            raise Refusal("an ideal effector with dynamics", "ideal, or rate, bandwidth and damping", ("ideal",))
        return self


class Surfaces(StrictModel):
    """Second-order actuators of the three axis deflections."""

    bandwidth: Annotated[AngularRate, Positive] = Field(description="natural frequency")
    damping: Annotated[float, Positive] = Field(description="damping ratio")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")
    rate_limit: Annotated[AngularRate, Positive] = Field(description="greatest rate of deflection")


class IdealSurfaces(StrictModel):
    """Deflections that are what is commanded."""

    ideal: Literal[True] = Field(description="no dynamics")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")


def _surfaces_kind(value: Any) -> str:
    return "ideal" if "ideal" in (value if isinstance(value, dict) else vars(value)) else "actuators"


SurfaceKeys = Annotated[
    Annotated[Surfaces, Tag("actuators")] | Annotated[IdealSurfaces, Tag("ideal")], Discriminator(_surfaces_kind)
]
