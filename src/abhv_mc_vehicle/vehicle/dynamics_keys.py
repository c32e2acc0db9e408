"""Pydantic models of the keys for custom dynamics in vehicle files."""

import keyword
from typing import Annotated

from pydantic import BeforeValidator, Field, model_validator

from abhv_mc.io.documents import File, Refusal, StrictModel, YesNo, describe
from abhv_mc.io.units import check_angle, dimension_of, parse_any, parse_quantity
from abhv_mc_vehicle.kernel.plant.state import MAX_STATES

Number = float | str


class CustomState(StrictModel):
    """Custom state: its unit and, if it has no equilibrium, its initial value."""

    unit: str = Field(description="SI unit of the state, such as m, rad/s or K; - if dimensionless")
    start: Number | None = Field(
        default=None,
        description="initial value of the state; default: its equilibrium value in trim",
    )

    circular: YesNo = Field(
        False, description="whether the state is an angle of which a full turn changes nothing"
    )

    @model_validator(mode="after")
    def _check(self) -> "CustomState":
        dimension_of(self.unit)
        if self.circular:
            check_angle(self.unit)
        if self.start is not None:
            parse_quantity(self.start, dimension_of(self.unit))
        return self


def _state(value: object) -> object:
    return {"unit": value} if isinstance(value, str) else value


class Dynamics(StrictModel):
    """Custom dynamics: states that cause forces and moments and affect the sensors."""

    file: File = Field(
        description=(
            "path of a Python file with one function decorated with @dynamics, relative to the "
            "vehicle file"
        )
    )
    states: dict[
        str,
        Annotated[CustomState, BeforeValidator(_state, json_schema_input_type=str | CustomState)],
    ] = Field(
        min_length=1, max_length=MAX_STATES, description="custom states by name, each with its unit"
    )
    settings: dict[str, Number] = Field(
        default_factory=dict,
        description="numbers passed to the function; a campaign may disperse them",
    )

    @model_validator(mode="after")
    def _check(self) -> "Dynamics":
        for key in ("states", "settings"):
            for name in getattr(self, key):
                if not name.isidentifier() or keyword.iskeyword(name) or name.startswith("_"):
                    raise Refusal(
                        f"invalid name {describe(name)}",
                        "an identifier such as mode_1",
                        (key, name),
                    )
        for name, value in self.settings.items():
            try:
                parse_any(value)
            except Refusal as refusal:
                raise Refusal(refusal.found, refusal.expected, ("settings", name)) from None
        return self
