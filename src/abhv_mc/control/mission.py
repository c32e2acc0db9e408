"""The mission file: where a flight starts, what it is asked to fly, and where it ends."""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, PlainSerializer, Tag, model_validator

from abhv_mc.control.trajectory_file import read_trajectory
from abhv_mc.io.documents import File, Refusal, StrictModel, read_document, validate
from abhv_mc.io.units import Angle, AngularRate, Length, Speed, Time, parse_in_unit
from abhv_mc.vehicle.limits import LoadLimits
from abhv_mc.world.earth import WGS84, Earth

Positive = Field(gt=0.0)
GravitationalParameter = Annotated[
    float,
    BeforeValidator(lambda value: parse_in_unit(value, "m3/s2")),
    PlainSerializer(lambda value: f"{value!r} m3/s2", when_used="json"),
]


class Start(StrictModel):
    """The start: straight, level, trimmed for 1 g, bank zero."""

    altitude: Length = Field(description="geodetic")
    speed: Annotated[Speed, Positive] = Field(description="relative to the Earth")
    heading: Angle = Field(description="of the velocity, clockwise from north")
    latitude: Annotated[Angle, Field(gt=-1.55, lt=1.55)] = Field(description="geodetic")
    longitude: Angle = 0.0


class Level(StrictModel):
    """Straight and level."""

    kind: Literal["level"]


class Climb(StrictModel):
    """Another altitude, and another speed if wanted; smooth: rate and acceleration begin and end at zero."""

    kind: Literal["climb"]
    altitude_change: Length
    length: Annotated[Time, Positive]
    speed_change: Speed = 0.0


class PullUp(StrictModel):
    """Another flight path angle, held afterwards; smooth."""

    kind: Literal["pull_up"]
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)]
    length: Annotated[Time, Positive]


class Turn(StrictModel):
    """Another heading; smooth. Positive to the right."""

    kind: Literal["turn"]
    heading_change: Angle
    length: Annotated[Time, Positive]


class SManoeuvre(StrictModel):
    """The track moved sideways by ``offset``: ``y = offset / 2 (1 - cos(pi t / length))``, original heading at the end.

    The lateral acceleration steps to its maximum at the beginning and back to zero at the end.
    """

    kind: Literal["s_manoeuvre"]
    offset: Length = Field(description="positive to the left of the start's heading (to the north, flying east)")
    length: Annotated[Time, Positive]


class WaypointTurn(StrictModel):
    """One heading change among several."""

    at: Annotated[Time, Field(ge=0.0)] = Field(description="after start_time")
    heading_change: Angle
    length: Annotated[Time, Positive]


class Waypoints(StrictModel):
    """Several heading changes; where they overlap, they add."""

    kind: Literal["waypoints"]
    turns: list[WaypointTurn] = Field(min_length=1)


class Recorded(StrictModel):
    """A trajectory from a CSV file with the columns time_s, altitude_m, speed_mps, heading_deg."""

    kind: Literal["recorded"]
    file: File


Manoeuvre = Annotated[Level | Climb | PullUp | Turn | SManoeuvre | Waypoints | Recorded, Field(discriminator="kind")]


class MissionLimits(LoadLimits):
    """A flight ends outside."""

    altitude: tuple[Length, Length] = (10e3, 40e3)

    @model_validator(mode="after")
    def _check(self) -> "MissionLimits":
        if self.altitude[0] >= self.altitude[1]:
            raise Refusal("an empty range", "the lower altitude before the higher one", ("altitude",))
        return self


class EarthNumbers(StrictModel):
    """The Earth as numbers; what is left out is WGS-84's."""

    equatorial_radius: Annotated[Length, Positive] = WGS84.equatorial_radius
    flattening: Annotated[float, Field(ge=0.0, lt=0.1)] = WGS84.flattening
    gravitational_parameter: Annotated[GravitationalParameter, Positive] = WGS84.gravitational_parameter
    j2: Annotated[float, Field(ge=0.0, lt=0.01)] = WGS84.j2
    rotation_rate: AngularRate = WGS84.rotation_rate


def _earth_kind(value: Any) -> str:
    return "name" if isinstance(value, str) else "numbers"


class Mission(StrictModel):
    """What a flight is asked to do."""

    name: str
    start: Start
    duration: Annotated[Time, Field(gt=0.0, le=3600.0)] = 60.0
    start_time: Annotated[Time, Field(ge=0.0)] = Field(0.0, description="when the manoeuvre begins")
    manoeuvre: Manoeuvre
    limits: MissionLimits = MissionLimits()
    earth: Annotated[
        Annotated[Literal["wgs84"], Tag("name")] | Annotated[EarthNumbers, Tag("numbers")],
        Discriminator(_earth_kind),
    ] = "wgs84"
    wind: Literal["none"] = Field(
        "none", description="in the nominal flight; a campaign disperses wind.north and so on"
    )
    step: Annotated[Time, Field(ge=1e-4, le=0.1)] = Field(0.01, description="of the integrator")

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
