"""The mission file: where a flight starts, what it is asked to fly, and where it ends."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    BeforeValidator,
    Discriminator,
    Field,
    PlainSerializer,
    Tag,
    WithJsonSchema,
    model_validator,
)

from abhv_mc.array_types import Floats
from abhv_mc.control.mission_tables import (
    DENSITIES,
    WIND,
    find_air_warnings,
    join_air,
    read_air_table,
    read_trajectory,
)
from abhv_mc.control.s_shape import s_shape
from abhv_mc.io.documents import File, Refusal, StrictModel, read_document, validate
from abhv_mc.io.input_files import made_once
from abhv_mc.io.units import Angle, AngularRate, Length, Mass, Pressure, Speed, Time, parse_in_unit
from abhv_mc.kernel.world.earth import WGS84, Earth
from abhv_mc.vehicle.shared_keys import LoadLimits, Positive, Rising, SensingKeys

_NORTHMOST = math.radians(89.99001)
_KIND = "the kind of manoeuvre"
_LENGTH = "how long it takes"
GravitationalParameter = Annotated[
    float,
    BeforeValidator(lambda value: parse_in_unit(value, "m3/s2")),
    PlainSerializer(lambda value: f"{value!r} m3/s2", when_used="json"),
    WithJsonSchema({"type": "string", "examples": ["3.986004418e14 m3/s2"]}),
]


class Start(StrictModel):
    """The start: trimmed for steady flight, straight and level unless a bank or a flight path angle is given.

    The reference begins along the flight path angle and keeps it until a manoeuvre changes it; a bank is the
    vehicle's alone, such as that which the first manoeuvre asks for at once.
    """

    altitude: Length = Field(description="geodetic altitude")
    speed: Annotated[Speed, Positive] = Field(description="speed relative to the Earth")
    heading: Angle = Field(description="direction of the velocity, clockwise from north")
    latitude: Annotated[Angle, Field(gt=-_NORTHMOST, lt=_NORTHMOST)] = Field(
        description="geodetic latitude, at most 89.99 deg"
    )
    longitude: Angle = Field(0.0, description="positive to the east")
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)] = Field(
        0.0, description="of a start in a climb or a descent"
    )
    bank: Annotated[Angle, Field(gt=-1.4, lt=1.4)] = Field(
        0.0, description="about the velocity, positive to the right"
    )


class Level(StrictModel):
    """Straight and level."""

    kind: Literal["level"] = Field(description=_KIND)


class Phase(StrictModel):
    """What a manoeuvre of a mission may say besides."""

    name: str | None = Field(
        None, description="by which 'phase' of a campaign's metric means its window"
    )


class Climb(Phase):
    """Another altitude, and another speed if wanted; smooth: rate and acceleration begin and end at zero."""

    kind: Literal["climb"] = Field(description=_KIND)
    altitude_change: Length = Field(description="positive upwards")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)
    speed_change: Speed = Field(0.0, description="over the same time")


class PullUp(Phase):
    """Another flight path angle, held afterwards; smooth."""

    kind: Literal["pull_up"] = Field(description=_KIND)
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)] = Field(
        description="at its end, positive upwards"
    )
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class Turn(Phase):
    """Another heading; smooth. Positive to the right."""

    kind: Literal["turn"] = Field(description=_KIND)
    heading_change: Angle = Field(description="positive to the right")
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


class SManoeuvre(Phase):
    """The track moved sideways by ``offset``, original heading at the end.

    The lateral acceleration goes as ``c |c|^(sharpness - 1)`` with ``c = cos(pi t / length)`` and is established, and
    left at the end, over ``bank_time``. Without the last two keys ``y = offset / 2 (1 - cos(pi t / length))``, and
    the acceleration steps at both ends.
    """

    kind: Literal["s_manoeuvre"] = Field(description=_KIND)
    offset: Length = Field(
        description="positive to the left of the start's heading (to the north, flying east)"
    )
    length: Annotated[Time, Positive] = Field(description=_LENGTH)
    bank_time: Annotated[Time, Field(ge=0.0)] = Field(
        0.0,
        description="in which the bank is established, and left at the end; at most half the length",
    )
    sharpness: Annotated[float, Field(ge=1.0, le=10.0)] = Field(
        1.0,
        description="exponent of the acceleration: the larger, the longer the flight between the turns is straight",
    )

    @model_validator(mode="after")
    def _check(self) -> "SManoeuvre":
        if self.bank_time > 0.5 * self.length:
            raise Refusal(
                f"{self.bank_time:g} s",
                f"at most half the length, {0.5 * self.length:g} s",
                ("bank_time",),
            )
        return self

    def lateral_motion(self, since: Floats) -> tuple[Floats, Floats]:
        """Speed (m/s) and acceleration (m/s2) to the left at times (s) since its beginning."""
        return s_shape(since, self.offset, self.length, self.bank_time, self.sharpness)


class WaypointTurn(StrictModel):
    """One heading change among several."""

    at: Annotated[Time, Field(ge=0.0)] = Field(
        description="when it begins, counted from start_time"
    )
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


class LevelPhase(Phase):
    """Nothing for a while: the flight path angle and the heading are held."""

    kind: Literal["level"] = Field(description=_KIND)
    length: Annotated[Time, Positive] = Field(description=_LENGTH)


InPhases = Annotated[LevelPhase | Climb | PullUp | Turn | SManoeuvre, Field(discriminator="kind")]


class Phases(StrictModel):
    """Manoeuvres one after another: each begins where the last one ends, and what the last one leaves is held."""

    kind: Literal["phases"] = Field(description=_KIND)
    phases: Annotated[tuple[InPhases, ...], Field(min_length=1)] = Field(
        description="the manoeuvres in their order"
    )


Manoeuvre = Annotated[
    Level | Climb | PullUp | Turn | SManoeuvre | Waypoints | Phases | Recorded,
    Field(discriminator="kind"),
]


class MissionLimits(LoadLimits):
    """A flight ends outside."""

    altitude: Annotated[tuple[Length, Length], Rising] = Field(
        (10e3, 40e3), description="lowest and highest"
    )
    speed: Annotated[Speed, Positive] | None = Field(
        None, description="greatest; left out: twice the largest speed of the reference"
    )
    fuel_out: bool = Field(
        True, description="whether a flight ends where its fuel is burnt; false: it flies on"
    )


class End(StrictModel):
    """The mission is done, before its duration, where any of these holds."""

    altitude_above: Length | None = Field(None, description="done where the altitude is above it")
    altitude_below: Length | None = Field(None, description="done where the altitude is below it")
    speed_above: Speed | None = Field(None, description="done where the speed is above it")
    speed_below: Speed | None = Field(None, description="done where the speed is below it")
    mach_above: float | None = Field(None, description="done where the Mach number is above it")
    mach_below: float | None = Field(None, description="done where the Mach number is below it")
    dynamic_pressure_above: Pressure | None = Field(
        None, description="done where the dynamic pressure is above it"
    )
    dynamic_pressure_below: Pressure | None = Field(
        None, description="done where the dynamic pressure is below it"
    )
    flight_path_angle_above: Angle | None = Field(
        None, description="done where the flight path angle is above it"
    )
    flight_path_angle_below: Angle | None = Field(
        None, description="done where the flight path angle is below it"
    )
    mass_below: Mass | None = Field(None, description="done where the mass is below it")

    def range_of(self, name: str) -> tuple[float, float]:
        """The range of a quantity within which the flight goes on."""
        low, high = getattr(self, f"{name}_below", None), getattr(self, f"{name}_above", None)
        return -math.inf if low is None else low, math.inf if high is None else high


class AirTable(StrictModel):
    """A table of levels, such as a sounding; its heads give units."""

    file: File = Field(description="the table, relative to this file")
    columns: dict[str, str] = Field(
        {}, description="heads of the table by name, such as {altitude: HGHT}"
    )


class WindTable(AirTable):
    """Wind of the nominal flight over altitude.

    Columns wind_north and wind_east (where it blows towards), or wind_speed and wind_direction (where from).
    """


class DensityTable(AirTable):
    """Nominal density over altitude, which controllers know.

    Columns density_factor (on the standard atmosphere), density, or pressure and temperature.
    """


class EarthNumbers(StrictModel):
    """The Earth as numbers; what is left out is WGS-84's."""

    equatorial_radius: Annotated[Length, Positive] = Field(
        WGS84.equatorial_radius, description="equatorial radius of the ellipsoid"
    )
    flattening: Annotated[float, Field(ge=0.0, lt=0.1)] = Field(
        WGS84.flattening, description="flattening of the ellipsoid; 0: a sphere"
    )
    gravitational_parameter: Annotated[GravitationalParameter, Positive] = Field(
        WGS84.gravitational_parameter,
        description="gravitational constant times the mass of the Earth",
    )
    j2: Annotated[float, Field(ge=0.0, lt=0.01)] = Field(
        WGS84.j2, description="second zonal harmonic; 0: a central field"
    )
    rotation_rate: AngularRate = Field(
        WGS84.rotation_rate, description="angular rate of the Earth; 0 rad/s: it does not turn"
    )


_BY_NAME = Discriminator(lambda value: "name" if isinstance(value, str) else "given")


class Mission(StrictModel):
    """What a flight is asked to do."""

    name: str = Field(description="name of the mission")
    start: Start = Field(description="where and how fast a flight starts")
    duration: Annotated[Time, Field(gt=0.0, le=3600.0)] = Field(
        60.0, description="how long a flight lasts"
    )
    start_time: Annotated[Time, Field(ge=0.0)] = Field(0.0, description="when the manoeuvre begins")
    manoeuvre: Manoeuvre = Field(description="what is flown")
    limits: MissionLimits = Field(MissionLimits(), description="a flight ends outside")
    earth: Annotated[
        Annotated[Literal["wgs84"], Tag("name")] | Annotated[EarthNumbers, Tag("given")],
        _BY_NAME,
    ] = Field("wgs84", description="wgs84, or numbers of its own")
    end: End = Field(End(), description="conditions that end a flight before its duration")
    wind: Annotated[
        Annotated[Literal["none"], Tag("name")] | Annotated[WindTable, Tag("given")], _BY_NAME
    ] = Field(
        "none",
        description="of the nominal flight, added to wind.north and so on; nominal controls know none",
    )
    density: Annotated[
        Annotated[Literal["standard"], Tag("name")] | Annotated[DensityTable, Tag("given")],
        _BY_NAME,
    ] = Field("standard", description="density of the nominal air")
    sensing: SensingKeys = Field(
        SensingKeys(), description="what instruments measure; left out: what the vehicle's do"
    )
    step: Annotated[Time, Field(ge=1e-4, le=0.1)] = Field(
        0.01, description="time step of the integrator"
    )

    @model_validator(mode="after")
    def _check(self) -> "Mission":
        low, high = self.limits.altitude
        if not low <= self.start.altitude <= high:
            raise Refusal(
                f"{self.start.altitude:g} m",
                f"an altitude in the limits, {low:g}..{high:g} m",
                ("start", "altitude"),
            )
        altitude, speed = self.start.altitude, self.start.speed
        names: set[str] = set()
        for place, _, manoeuvre in self.moves():
            name = getattr(manoeuvre, "name", None)
            if name in names:
                raise Refusal(f"'{name}' twice", "a name for each phase", (*place, "name"))
            names |= {name} if name is not None else set()
            if isinstance(manoeuvre, SManoeuvre):
                sideways = abs(manoeuvre.lateral_motion(np.array([0.5 * manoeuvre.length]))[0][0])
                if sideways > 0.5 * speed:
                    raise Refusal(
                        f"an S that asks for {sideways:.0f} m/s sideways",
                        f"at most half the speed, {0.5 * speed:.0f} m/s",
                        (*place, "offset"),
                    )
            if isinstance(manoeuvre, Climb):
                altitude, speed = (
                    altitude + manoeuvre.altitude_change,
                    speed + manoeuvre.speed_change,
                )
                if not low <= altitude <= high:
                    raise Refusal(
                        f"a climb to {altitude:g} m",
                        f"an altitude in the limits, {low:g}..{high:g} m",
                        (*place, "altitude_change"),
                    )
                if speed <= 0.0:
                    raise Refusal(
                        "a speed of zero or less", "a positive one", (*place, "speed_change")
                    )
        if isinstance(self.manoeuvre, Recorded) and self.start.flight_path_angle:
            raise Refusal(
                "a flight path angle beside a recorded trajectory",
                "the recording's own",
                ("start", "flight_path_angle"),
            )
        return self

    def moves(self) -> "list[tuple[tuple[str | int, ...], float, Any]]":
        """Manoeuvres in their order: place in the file, time at which each begins (s), and itself."""
        if not isinstance(self.manoeuvre, Phases):
            return [(("manoeuvre",), self.start_time, self.manoeuvre)]
        begin = self.start_time
        found: list[tuple[tuple[str | int, ...], float, Any]] = []
        for i, phase in enumerate(self.manoeuvre.phases):
            found.append((("manoeuvre", "phases", i), begin, phase))
            begin += phase.length
        return found

    def windows(self) -> dict[str, tuple[float, float]]:
        """Begin and end (s) of the phases that have names."""
        named = [
            (begin, move)
            for _, begin, move in self.moves()
            if getattr(move, "name", None) is not None
        ]
        return {move.name: (begin, begin + move.length) for begin, move in named}

    def read_air(self) -> tuple[Floats | None, Floats | None]:
        """Return the tables of the wind and of the density, None where there is none. Raise InputError."""
        wind, density = self.wind, self.density
        return (
            None if isinstance(wind, str) else read_air_table(wind.file, WIND, wind.columns),
            None
            if isinstance(density, str)
            else read_air_table(density.file, DENSITIES, density.columns),
        )

    def make_air(self) -> Floats:
        """Return the nominal air [level, column], see :mod:`abhv_mc.kernel.plant.air_data`. Raise InputError."""
        return join_air(*self.read_air())

    def find_air_warnings(self, altitude: Floats) -> list[str]:
        """Return warnings of tables of the air that end within a flight's altitudes."""
        return [
            warning
            for key, table in zip((self.wind, self.density), self.read_air(), strict=True)
            if not isinstance(key, str) and table is not None
            for warning in find_air_warnings(Path(key.file), table, altitude)
        ]

    def make_earth(self) -> Earth:
        """The Earth record of the plant."""
        if isinstance(self.earth, str):
            return WGS84
        return Earth(**{name: getattr(self.earth, name) for name in EarthNumbers.model_fields})


@made_once
def read_mission(path: str | Path) -> Mission:
    """Read and check a mission file and what it refers to. Raises :class:`abhv_mc.io.documents.InputError`."""
    mission = validate(read_document(path), Mission)
    if isinstance(mission.manoeuvre, Recorded):
        read_trajectory(mission.manoeuvre.file, mission.duration)
    mission.make_air()
    return mission
