"""Keys of the engines and control surfaces in a vehicle file."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from abhv_mc.io.documents import File, Refusal, StrictModel
from abhv_mc.io.units import (
    Acceleration,
    Angle,
    AngularRate,
    Area,
    Fraction,
    Frequency,
    Length,
    Time,
)
from abhv_mc.kernel.plant.vehicle import MAX_ENGINES, Inlet
from abhv_mc.vehicle.shared_keys import AngleRange, Positive, Range, Rising

# FIXED_TABLE_ROWS of the propulsion and the keys that name their tables.
PROPULSION_TABLES = {
    "capture_area_ratio": "capture_area_ratio",
    "specific_impulse": "specific_impulse",
    "thrust_area": "area",
}


class PythonFunction(StrictModel):
    """Custom function of the vehicle, compiled separately from the flight."""

    python: File = Field(description="Python file, relative to this file")
    settings: dict[str, Any] = Field(
        default_factory=dict, description="values of its class Settings"
    )


class ThrustLine(StrictModel):
    """Line of thrust, relative to the moment reference."""

    inclination: Angle = Field(default=0.0, description="angle of the thrust, upward")
    offset: Length = Field(
        default=0.0, description="below the moment reference: positive pitches nose up"
    )


class Unstart(StrictModel):
    """Flow in which the inlet stays started; outside it the engine fails."""

    angle_of_attack: AngleRange = Field(
        default=(-math.inf, math.inf), description="least and greatest"
    )
    sideslip: Annotated[Angle, Positive] = Field(
        default=math.inf, description="greatest, to either side"
    )
    mach: Range = Field(default=(-math.inf, math.inf), description="least and greatest")
    restart_delay: Annotated[Time, Field(ge=0.0)] = Field(
        default=math.inf, description="time inside the range until it restarts; left out: never"
    )
    drag_increment: float = Field(
        default=0.0, description="added to the drag coefficient while unstarted"
    )
    pitching_moment_increment: float = Field(
        default=0.0, description="added to the pitching moment coefficient while unstarted"
    )

    @model_validator(mode="after")
    def _check(self) -> "Unstart":
        if not self.model_fields_set & {"angle_of_attack", "sideslip", "mach"}:
            raise Refusal("unstart without a condition", "angle_of_attack, sideslip or mach")
        return self

    def inlet(self) -> Inlet:
        """Return the condition as numbers of the kernel."""
        return Inlet(
            1.0,
            *self.angle_of_attack,
            self.sideslip,
            *self.mach,
            self.restart_delay,
            self.drag_increment,
            self.pitching_moment_increment,
        )


class Relight(StrictModel):
    """Recovery of an engine after a failure; its flame-out follows the lag of the throttle."""

    delay: Annotated[Time, Field(ge=0.0)] = Field(
        0.0, description="time until the thrust begins to recover"
    )
    time_constant: Annotated[Time, Field(ge=0.0)] = Field(
        0.0, description="time constant of the thrust; 0: the lag of the throttle"
    )


class Engine(StrictModel):
    """One of several engines, which may fail separately."""

    share: Annotated[Fraction, Positive] | None = Field(
        None, description="share of the thrust; left out: equal shares"
    )
    x: Length = Field(0.0, description="position forward of the thrust line's reference")
    y: Length = Field(0.0, description="position to the right of the thrust line")
    z: Length = Field(0.0, description="position below the thrust line")


def engine_rows(engines: dict[str, Engine]) -> list[tuple[float, float, float, float]]:
    """Return share and position (x, y, z) of each engine."""
    return [
        (engine.share or 1.0 / len(engines), engine.x, engine.y, engine.z)
        for engine in engines.values()
    ]


class _Inlets(StrictModel):
    unstart: Unstart | None = Field(
        default=None,
        description="flow in which the inlet stays started; left out: in any flow",
    )
    engines: dict[str, Engine] = Field(
        default_factory=dict,
        max_length=MAX_ENGINES,
        description="several engines by name; left out: one engine",
    )

    @model_validator(mode="after")
    def _check_engines(self) -> Self:
        rows = engine_rows(self.engines)
        total = sum(share for share, *_ in rows)
        moments = [sum(row[0] * row[i] for row in rows) for i in (1, 2, 3)]
        has_mixed_shares = len({engine.share is None for engine in self.engines.values()}) > 1
        if rows and (has_mixed_shares or abs(total - 1.0) > 1e-9):
            raise Refusal(
                f"shares of the thrust with the sum {total:g}",
                "shares with the sum 1, or no shares",
                ("engines",),
            )
        if max(map(abs, moments)) > 1e-6:
            problem = f"engines whose thrust acts {', '.join(f'{x:g}' for x in moments)} m from the line of thrust"
            raise Refusal(problem, "positions with the weighted mean 0", ("engines",))
        return self


class _Propulsion(_Inlets):
    specific_impulse: str = Field(description="name of the table of specific impulse")
    standard_gravity: Annotated[Acceleration, Positive] = Field(
        default=9.80665, description="gravity in the definition of the specific impulse"
    )
    thrust_line: ThrustLine = Field(
        ThrustLine(), description="where the thrust acts; left out: along body x"
    )
    equivalence_ratio: Annotated[tuple[Annotated[float, Field(ge=0.0)], float], Rising] = Field(
        description="least and greatest"
    )
    bandwidth: Annotated[AngularRate, Positive] = Field(
        description="natural frequency of the throttle"
    )
    damping: Annotated[float, Positive] = Field(description="damping ratio of the throttle")
    rate_limit: Annotated[Frequency, Positive] = Field(description="greatest rate of the throttle")
    relight: Relight = Field(Relight(), description="recovery after a failure")


class Capture(_Propulsion):
    """T = stoichiometric ratio * eta * Isp * g0 * rho * V * capture area ratio * cowl area."""

    kind: Literal["capture"] = Field(description="method of computing thrust")
    stoichiometric_ratio: Annotated[Fraction, Positive] = Field(description="fuel to air, by mass")
    cowl_area: Annotated[Area, Positive] = Field(description="area of the inlet cowl")
    capture_area_ratio: str = Field(description="name of the table of captured area over cowl area")


class ThrustArea(_Propulsion):
    """T = dynamic pressure * thrust area."""

    kind: Literal["thrust_area"] = Field(description="method of computing thrust")
    area: str = Field(description="name of the table of thrust over dynamic pressure")


class ThrustFunction(PythonFunction, _Inlets):
    """Thrust as a Python function of air data and throttle."""

    function: str = Field("thrust", description="name of the function")
    throttle: Range = Field((0.0, 1.0), description="least and greatest throttle")
    ideal: bool = Field(False, description="whether the throttle equals its command")
    bandwidth: Annotated[AngularRate, Positive] | None = Field(
        default=None, description="natural frequency of the throttle"
    )
    damping: Annotated[float, Positive] = Field(
        default=1.0, description="damping ratio of the throttle"
    )
    rate_limit: Annotated[Frequency, Positive] | None = Field(
        default=None, description="greatest rate of the throttle"
    )

    @model_validator(mode="after")
    def _check(self) -> "ThrustFunction":
        if self.ideal == (self.bandwidth is not None and self.rate_limit is not None):
            raise Refusal(
                "both or neither of ideal, and bandwidth with rate_limit",
                "either ideal, or bandwidth and rate_limit",
            )
        return self


def _propulsion_kind(value: Any) -> str:
    keys = value if isinstance(value, dict) else vars(value)
    return "python" if "python" in keys else str(keys.get("kind"))


Propulsion = Annotated[
    Annotated[Capture, Tag("capture")]
    | Annotated[ThrustArea, Tag("thrust_area")]
    | Annotated[ThrustFunction, Tag("python")],
    Discriminator(_propulsion_kind),
]


AXIS_DEFLECTIONS = ("aileron", "rudder", "elevator")


class Effector(StrictModel):
    """One surface: its deflection per deflection of each axis, and optionally its actuator."""

    aileron: float = Field(0.0, description="deflection per aileron command")
    rudder: float = Field(0.0, description="deflection per rudder command")
    elevator: float = Field(0.0, description="deflection per elevator command")
    limits: tuple[Angle, Angle] | None = Field(
        default=None, description="least and greatest deflection"
    )
    rate: Annotated[AngularRate, Positive] | None = Field(
        default=None, description="greatest rate of deflection"
    )
    bandwidth: Annotated[AngularRate, Positive] | None = Field(
        default=None, description="natural frequency"
    )
    damping: Annotated[float, Positive] | None = Field(default=None, description="damping ratio")
    ideal: bool = Field(False, description="whether the deflection equals its command")

    @property
    def driven(self) -> bool:
        """True if it has a separate actuator; missing values are those of ``surfaces``."""
        return bool(self.model_fields_set - set(AXIS_DEFLECTIONS))

    @model_validator(mode="after")
    def _check(self) -> "Effector":
        if self.limits is not None and not self.limits[0] <= 0.0 <= self.limits[1]:
            raise Refusal(f"{list(self.limits)} rad", "least and greatest, about 0", ("limits",))
        if self.ideal and (self.rate or self.bandwidth or self.damping):
            raise Refusal(
                "an ideal effector with dynamics",
                "either ideal, or rate, bandwidth and damping",
                ("ideal",),
            )
        return self


class Surfaces(StrictModel):
    """Second-order actuators of the three axis deflections."""

    bandwidth: Annotated[AngularRate, Positive] = Field(description="natural frequency")
    damping: Annotated[float, Positive] = Field(description="damping ratio")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")
    rate_limit: Annotated[AngularRate, Positive] = Field(description="greatest rate of deflection")


class IdealSurfaces(StrictModel):
    """Deflections that equal their commands."""

    ideal: Literal[True] = Field(description="no dynamics")
    limit: Annotated[Angle, Positive] = Field(description="greatest deflection, to either side")


def _surfaces_kind(value: Any) -> str:
    return (
        "ideal" if "ideal" in (value if isinstance(value, dict) else vars(value)) else "actuators"
    )


SurfaceKeys = Annotated[
    Annotated[Surfaces, Tag("actuators")] | Annotated[IdealSurfaces, Tag("ideal")],
    Discriminator(_surfaces_kind),
]
