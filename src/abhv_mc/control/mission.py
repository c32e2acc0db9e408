"""The mission file: where a flight starts, what it is asked to fly, and where it ends."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, PlainSerializer, Tag, WithJsonSchema, model_validator

from abhv_mc.control.trajectory_file import read_trajectory
from abhv_mc.io.documents import File, Refusal, StrictModel, read_document, validate
from abhv_mc.io.units import Angle, AngularRate, Length, Speed, Time, parse_in_unit
from abhv_mc.world.earth import WGS84, Earth

Positive = Field(gt=0.0)
_KIND = "the kind of manoeuvre"
_LENGTH = "how long it takes"
GravitationalParameter = Annotated[
    float,
    BeforeValidator(lambda value: parse_in_unit(value, "m3/s2")),
    PlainSerializer(lambda value: f"{value!r} m3/s2", when_used="json"),
    WithJsonSchema({"type": "string", "examples": ["3.986004418e14 m3/s2"]}),
]


class Start(StrictModel):
    """The start: straight, level, trimmed for 1 g, bank zero."""

    altitude: Length = Field(description="geodetic altitude")
    speed: Annotated[Speed, Positive] = Field(description="speed relative to the Earth")
    heading: Angle = Field(description="direction of the velocity, clockwise from north")
    latitude: Annotated[Angle, Field(gt=-1.55, lt=1.55)] = Field(description="geodetic latitude")
    longitude: Angle = Field(0.0, description="positive to the east")


class Level(StrictModel):
    """Straight and level."""

    kind: Literal["level"] = Field(description=_KIND)


class Climb(StrictModel):
    """Another altitude, and another speed if wanted; smooth: rate and acceleration begin and end at zero."""

    kind: Literal["climb"] = Field(description=_KIND)
    altitude_change: Length = Field(description="positive upwards")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)
    speed_change: Speed = Field(0.0, description="over the same time")


class PullUp(StrictModel):
    """Another flight path angle, held afterwards; smooth."""

    kind: Literal["pull_up"] = Field(description=_KIND)
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)] = Field(description="at its end, positive upwards")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class Turn(StrictModel):
    """Another heading; smooth. Positive to the right."""

    kind: Literal["turn"] = Field(description=_KIND)
    heading_change: Angle = Field(description="positive to the right")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class SManoeuvre(StrictModel):
    """The track moved sideways by ``offset``: ``y = offset / 2 (1 - cos(pi t / length))``, original heading at the end.

    The lateral acceleration steps to its maximum at the beginning and back to zero at the end.
    """

    kind: Literal["s_manoeuvre"] = Field(description=_KIND)
    offset: Length = Field(description="positive to the left of the start's heading (to the north, flying east)")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class WaypointTurn(StrictModel):
    """One heading change among several."""

    at: Annotated[Time, Field(ge=0.0)] = Field(description="when it begins, counted from start_time")
    heading_change: Angle = Field(description="positive to the right")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class Waypoints(StrictModel):
    """Several heading changes; where they overlap, they add."""

    kind: Literal["waypoints"] = Field(description=_KIND)
    turns: list[WaypointTurn] = Field(min_length=1, description="the heading changes")


class Recorded(StrictModel):
    """A trajectory from a CSV file with the columns time_s, altitude_m, speed_mps, heading_deg."""

    kind: Literal["recorded"] = Field(description=_KIND)
    file: File = Field(description="the CSV file, relative to this file")


Manoeuvre = Annotated[Level | Climb | PullUp | Turn | SManoeuvre | Waypoints | Recorded, Field(discriminator="kind")]


class MissionLimits(StrictModel):
    """A flight ends outside."""

    altitude: tuple[Length, Length] = Field((10e3, 40e3), description="lowest and highest")

    @model_validator(mode="after")
    def _check(self) -> "MissionLimits":
        if self.altitude[0] >= self.altitude[1]:
            raise Refusal("an empty range", "the lower altitude before the higher one", ("altitude",))
        return self


class EarthNumbers(StrictModel):
    """The Earth as numbers; what is left out is WGS-84's."""

    equatorial_radius: Annotated[Length, Positive] = Field(
        WGS84.equatorial_radius, description="equatorial radius of the ellipsoid"
    )
    flattening: Annotated[float, Field(ge=0.0, lt=0.1)] = Field(
        WGS84.flattening, description="flattening of the ellipsoid; 0: a sphere"
    )
    gravitational_parameter: Annotated[GravitationalParameter, Positive] = Field(
        WGS84.gravitational_parameter, description="gravitational constant times the mass of the Earth"
    )
    j2: Annotated[float, Field(ge=0.0, lt=0.01)] = Field(
        WGS84.j2, description="second zonal harmonic; 0: a central field"
    )
    rotation_rate: AngularRate = Field(
        WGS84.rotation_rate, description="angular rate of the Earth; 0 rad/s: it does not turn"
    )


def _earth_kind(value: Any) -> str:
    return "name" if isinstance(value, str) else "numbers"


class Mission(StrictModel):
    """What a flight is asked to do."""

    name: str = Field(description="name of the mission")
    start: Start = Field(description="where and how fast a flight starts")
    duration: Annotated[Time, Field(gt=0.0, le=3600.0)] = Field(60.0, description="how long a flight lasts")
    start_time: Annotated[Time, Field(ge=0.0)] = Field(0.0, description="when the manoeuvre begins")
    manoeuvre: Manoeuvre = Field(description="what is flown")
    limits: MissionLimits = Field(MissionLimits(), description="a flight ends outside")
    earth: Annotated[
        Annotated[Literal["wgs84"], Tag("name")] | Annotated[EarthNumbers, Tag("numbers")],
        Discriminator(_earth_kind),
    ] = Field("wgs84", description="wgs84, or numbers of its own")
    wind: Literal["none"] = Field(
        "none", description="wind of the nominal flight; a campaign disperses wind.north and so on"
    )
    step: Annotated[Time, Field(ge=1e-4, le=0.1)] = Field(0.01, description="time step of the integrator")

    @model_validator(mode="after")
    def _check(self) -> "Mission":
        low, high = self.limits.altitude
        if not low <= self.start.altitude <= high:
            raise Refusal(
                f"{self.start.altitude:g} m", f"an altitude in the limits, {low:g}..{high:g} m", ("start", "altitude")
            )
        manoeuvre = self.manoeuvre
        if isinstance(manoeuvre, SManoeuvre):
            sideways = 0.5 * abs(manoeuvre.offset) * 3.1416 / manoeuvre.length
            if sideways > 0.5 * self.start.speed:
                raise Refusal(
                    f"an S that asks for {sideways:.0f} m/s sideways",
                    f"at most half the speed, {0.5 * self.start.speed:.0f} m/s",
                    ("manoeuvre", "offset"),
                )
        if isinstance(manoeuvre, Climb):
            if not low <= self.start.altitude + manoeuvre.altitude_change <= high:
                raise Refusal(
                    f"a climb to {self.start.altitude + manoeuvre.altitude_change:g} m",
                    f"an altitude in the limits, {low:g}..{high:g} m",
                    ("manoeuvre", "altitude_change"),
                )
            if self.start.speed + manoeuvre.speed_change <= 0.0:
                raise Refusal("a speed of zero or less", "a positive one", ("manoeuvre", "speed_change"))
        return self

    def make_earth(self) -> Earth:
        """The Earth record of the plant."""
        if isinstance(self.earth, str):
            return WGS84
        return Earth(**{name: getattr(self.earth, name) for name in EarthNumbers.model_fields})


def read_mission(path: str | Path) -> Mission:
    """Read and check a mission file and what it refers to. Raises :class:`abhv_mc.io.documents.InputError`."""
    mission = validate(read_document(path), Mission)
    if isinstance(mission.manoeuvre, Recorded):
        read_trajectory(mission.manoeuvre.file, mission.duration)
    return mission
