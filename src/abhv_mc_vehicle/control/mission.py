"""Pydantic model of the mission file: start, manoeuvres, environment, end of a flight."""

import math
from itertools import pairwise
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
from abhv_mc.io.documents import CommaKeys, File, StrictModel, read_document, validate
from abhv_mc.io.input_files import made_once
from abhv_mc.io.messages import InputError, Refusal
from abhv_mc.io.units import Angle, AngularRate, Length, Mass, Pressure, Speed, Time, parse_in_unit
from abhv_mc_vehicle.control.mission_tables import (
    DENSITIES,
    WIND,
    find_air_warnings,
    find_imbalance,
    join_air,
    read_air_table,
    read_ensemble,
    read_trajectory,
)
from abhv_mc_vehicle.control.s_shape import s_shape
from abhv_mc_vehicle.kernel.world.earth import WGS84, Earth
from abhv_mc_vehicle.vehicle.shared_keys import LoadLimits, Positive, Rising, SensingKeys

_NORTHMOST = math.radians(89.99001)
_KIND = Field(description="kind of manoeuvre")
_LENGTH = Field(description="duration of the manoeuvre")
Duration = Annotated[Time, Positive]
GravitationalParameter = Annotated[
    float,
    BeforeValidator(lambda value: parse_in_unit(value, "m3/s2")),
    PlainSerializer(lambda value: f"{value!r} m3/s2", when_used="json"),
    WithJsonSchema({"type": "string", "examples": ["3.986004418e14 m3/s2"]}),
]


class Start(StrictModel):
    """Start of a flight: trimmed and, by default, straight and level.

    The reference starts along the flight path angle and maintains it until a manoeuvre changes it.
    The bank applies only to the vehicle; it may be, for example, the bank that the first manoeuvre
    needs from the start.
    """

    altitude: Length
    """initial geodetic altitude"""
    speed: Annotated[Speed, Positive]
    """initial speed relative to the Earth"""
    heading: Angle
    """initial heading, clockwise from north"""
    latitude: Annotated[Angle, Field(gt=-_NORTHMOST, lt=_NORTHMOST)]
    """initial geodetic latitude, at most 89.99 deg in magnitude"""
    longitude: Angle = 0.0
    """initial longitude, positive to the east"""
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)] = 0.0
    """initial flight path angle, if the flight starts in a climb or descent"""
    bank: Annotated[Angle, Field(gt=-1.4, lt=1.4)] = 0.0
    """initial bank angle about the velocity, positive to the right"""


class Level(StrictModel):
    """Straight and level flight."""

    kind: Literal["level"] = _KIND


class Phase(StrictModel):
    """Manoeuvre with an optional name."""

    name: str | None = None
    """name of the manoeuvre; the key 'phase' of a metric can select its time window by this name"""


class Climb(Phase):
    """Smooth change of altitude and speed, with zero rate and acceleration at both ends."""

    kind: Literal["climb"] = _KIND
    altitude_change: Length
    """change of altitude, positive upwards"""
    length: Duration = _LENGTH
    speed_change: Speed = 0.0
    """change of speed during the manoeuvre"""


class PullUp(Phase):
    """Smooth change of the flight path angle, which remains constant afterwards."""

    kind: Literal["pull_up"] = _KIND
    flight_path_angle: Annotated[Angle, Field(gt=-1.0, lt=1.0)]
    """flight path angle at the end of the pull-up, positive upwards"""
    length: Duration = _LENGTH


class Turn(Phase):
    """Smooth change of the heading, positive to the right."""

    kind: Literal["turn"] = _KIND
    heading_change: Angle
    """change of heading, positive to the right"""
    length: Duration = _LENGTH


class SManoeuvre(Phase):
    """Lateral displacement of the track by ``offset``, with the original heading at the end.

    The lateral acceleration is proportional to ``c |c|^(sharpness - 1)`` with ``c = cos(pi t /
    length)``, ramped over ``bank_time`` at both ends. If ``bank_time`` and ``sharpness`` are
    omitted, ``y = offset / 2 (1 - cos(pi t / length))`` and the acceleration has steps at both
    ends.
    """

    kind: Literal["s_manoeuvre"] = _KIND
    offset: Length
    """displacement, positive to the left of the initial heading (north when flying east)"""
    length: Duration = _LENGTH
    bank_time: Annotated[Time, Field(ge=0.0)] = 0.0
    """duration of the bank ramp at each end of the manoeuvre, at most half the manoeuvre's
    length"""
    sharpness: Annotated[float, Field(ge=1.0, le=10.0)] = 1.0
    """exponent of the acceleration; larger values give longer straight flight between the turns"""

    @model_validator(mode="after")
    def _check(self) -> "SManoeuvre":
        if self.bank_time > 0.5 * self.length:
            raise Refusal(
                f"found {self.bank_time:g} s",
                f"at most half the length, {0.5 * self.length:g} s",
                ("bank_time",),
            )
        return self

    def lateral_motion(self, since: Floats) -> tuple[Floats, Floats]:
        """Return the lateral speed (m/s) and acceleration (m/s2) at the given times (s).

        Both are positive to the left.
        """
        return s_shape(since, self.offset, self.length, self.bank_time, self.sharpness)


class WaypointTurn(StrictModel):
    """One of several changes of heading."""

    at: Annotated[Time, Field(ge=0.0)]
    """time after start_time at which the change starts"""
    heading_change: Angle
    """change of heading, positive to the right"""
    length: Duration = _LENGTH


class Waypoints(StrictModel):
    """Several changes of heading, which add up if they overlap."""

    kind: Literal["waypoints"] = _KIND
    turns: list[WaypointTurn] = Field(min_length=1)
    """heading changes of the mission"""


class Recorded(StrictModel):
    """Trajectory from a CSV file with columns time_s, altitude_m, speed_mps and heading_deg."""

    kind: Literal["recorded"] = _KIND
    file: File
    """CSV file of the trajectory, relative to the mission file"""


class LevelPhase(Phase):
    """Flight with constant flight path angle and heading."""

    kind: Literal["level"] = _KIND
    length: Duration = _LENGTH


InPhases = Annotated[LevelPhase | Climb | PullUp | Turn | SManoeuvre, Field(discriminator="kind")]


class Phases(StrictModel):
    """Sequence of manoeuvres, each starting with the final values of the previous one."""

    kind: Literal["phases"] = _KIND
    phases: Annotated[tuple[InPhases, ...], Field(min_length=1)]
    """manoeuvres in order"""


Manoeuvre = Annotated[
    Level | Climb | PullUp | Turn | SManoeuvre | Waypoints | Phases | Recorded,
    Field(discriminator="kind"),
]


class MissionLimits(LoadLimits):
    """Limits that end a flight."""

    altitude: Annotated[tuple[Length, Length], Rising] = (10e3, 40e3)
    """minimum and maximum altitude"""
    speed: Annotated[Speed, Positive] | None = None
    """maximum speed; default: twice the largest speed of the reference"""
    fuel_out: bool = True
    """whether a flight ends when its fuel is exhausted"""


class End(StrictModel):
    """Conditions, any of which ends the mission before its full duration has elapsed."""

    altitude_above: Length | None = None
    """the mission is complete when the altitude exceeds this value"""
    altitude_below: Length | None = None
    """the mission is complete when the altitude is below this value"""
    speed_above: Speed | None = None
    """the mission is complete when the speed exceeds this value"""
    speed_below: Speed | None = None
    """the mission is complete when the speed is below this value"""
    mach_above: float | None = None
    """the mission is complete when the Mach number exceeds this value"""
    mach_below: float | None = None
    """the mission is complete when the Mach number is below this value"""
    dynamic_pressure_above: Pressure | None = None
    """the mission is complete when the dynamic pressure exceeds this value"""
    dynamic_pressure_below: Pressure | None = None
    """the mission is complete when the dynamic pressure is below this value"""
    flight_path_angle_above: Angle | None = None
    """the mission is complete when the flight path angle exceeds this value"""
    flight_path_angle_below: Angle | None = None
    """the mission is complete when the flight path angle is below this value"""
    mass_below: Mass | None = None
    """the mission is complete when the mass is below this value"""

    def range_of(self, name: str) -> tuple[float, float]:
        """Return the range of the quantity ``name`` within which the flight continues."""
        low = getattr(self, f"{name}_below", None)
        high = getattr(self, f"{name}_above", None)
        return -math.inf if low is None else low, math.inf if high is None else high


class AirTable(CommaKeys):
    """Table over altitude, such as a sounding, with units in the header."""

    file: File
    """CSV file of the table, relative to the mission file"""
    columns: dict[str, str] = {}
    """column headers in the table by quantity, such as {altitude: HGHT}"""


class WindTable(AirTable):
    """Wind in the nominal flight as a function of altitude.

    Columns are wind_north and wind_east (velocity of the air), or wind_speed and wind_direction
    (direction from which the wind blows).
    """


class DensityTable(AirTable):
    """Nominal density as a function of altitude, for which controllers are designed.

    Columns are density_factor (relative to the standard atmosphere), density, or pressure and
    temperature.
    """


class Ensemble(CommaKeys):
    """Atmospheres of which each flight of a campaign has one."""

    ensemble: File
    """CSV or Parquet file with the columns member, altitude, those of 'wind' and of 'density',
    and optionally weight"""
    columns: dict[str, str] = {}
    """column headers in the table by quantity, such as {altitude: HGHT}"""


class EarthNumbers(StrictModel):
    """Constants of the Earth model; the defaults are those of WGS-84."""

    equatorial_radius: Annotated[Length, Positive] = WGS84.equatorial_radius
    """equatorial radius of the ellipsoid"""
    flattening: Annotated[float, Field(ge=0.0, lt=0.1)] = WGS84.flattening
    """flattening of the ellipsoid; 0: a sphere"""
    gravitational_parameter: Annotated[GravitationalParameter, Positive] = (
        WGS84.gravitational_parameter
    )
    """product of the gravitational constant and the mass of the Earth"""
    j2: Annotated[float, Field(ge=0.0, lt=0.01)] = WGS84.j2
    """second zonal harmonic; 0: a central field"""
    rotation_rate: AngularRate = WGS84.rotation_rate
    """angular rate of the Earth; 0 rad/s: no rotation"""


_BY_NAME = Discriminator(lambda value: "name" if isinstance(value, str) else "given")


class Mission(StrictModel):
    """Mission of a flight: start, manoeuvres, limits, environment and end."""

    name: str
    """name of the mission"""
    start: Start
    """position, speed and attitude at the start"""
    duration: Annotated[Time, Field(gt=0.0, le=3600.0)] = 60.0
    """duration of a flight"""
    start_time: Annotated[Time, Field(ge=0.0)] = 0.0
    """time at which the manoeuvre starts"""
    manoeuvre: Manoeuvre
    """manoeuvre or sequence of manoeuvres"""
    limits: MissionLimits = MissionLimits()
    """limits that end a flight"""
    earth: Annotated[
        Annotated[Literal["wgs84"], Tag("name")] | Annotated[EarthNumbers, Tag("given")],
        _BY_NAME,
    ] = "wgs84"
    """model of the Earth: wgs84, or custom constants"""
    end: End = End()
    """conditions that complete the mission before its duration has elapsed"""
    wind: Annotated[
        Annotated[Literal["none"], Tag("name")] | Annotated[WindTable, Tag("given")], _BY_NAME
    ] = "none"
    """wind of the nominal flight, to which wind.north etc. are added; nominal controls are
    computed without wind"""
    density: Annotated[
        Annotated[Literal["standard"], Tag("name")] | Annotated[DensityTable, Tag("given")],
        _BY_NAME,
    ] = "standard"
    """air density of the nominal flight: standard atmosphere, or a table"""
    atmosphere: Ensemble | None = None
    """members that campaigns draw as `atmosphere.member`; a member replaces the tables of 'wind'
    and 'density', which remain those of the nominal flight"""
    sensing: SensingKeys = SensingKeys()
    """reference for the measured quantities; default: the reference in the vehicle file"""
    step: Annotated[Time, Field(ge=1e-4, le=0.1)] = 0.01
    """time step of the integrator"""

    @model_validator(mode="after")
    def _check(self) -> "Mission":
        low, high = self.limits.altitude
        if not low <= self.start.altitude <= high:
            raise Refusal(
                f"found {self.start.altitude:g} m",
                f"an altitude within the limits, {low:g} to {high:g} m",
                ("start", "altitude"),
            )
        altitude = self.start.altitude
        speed = self.start.speed
        names: set[str] = set()
        for key, _, manoeuvre in self.list_manoeuvres():
            name = getattr(manoeuvre, "name", None)
            if name in names:
                raise Refusal(f"duplicate name '{name}'", "a unique name", (*key, "name"))
            names |= {name} if name is not None else set()
            if isinstance(manoeuvre, SManoeuvre):
                lateral_speed = abs(
                    manoeuvre.lateral_motion(np.array([0.5 * manoeuvre.length]))[0][0]
                )
                if lateral_speed > 0.5 * speed:
                    raise Refusal(
                        f"the S manoeuvre has a lateral speed of {lateral_speed:.0f} m/s",
                        f"at most half the flight speed, {0.5 * speed:.0f} m/s",
                        (*key, "offset"),
                    )
            if isinstance(manoeuvre, Climb):
                altitude = altitude + manoeuvre.altitude_change
                speed = speed + manoeuvre.speed_change
                if not low <= altitude <= high:
                    raise Refusal(
                        f"the altitude changes to {altitude:g} m",
                        f"an altitude within the limits, {low:g} to {high:g} m",
                        (*key, "altitude_change"),
                    )
                if speed <= 0.0:
                    raise Refusal(
                        f"the speed changes to {speed:g} m/s",
                        "a positive speed",
                        (*key, "speed_change"),
                    )
        if isinstance(self.manoeuvre, Recorded) and self.start.flight_path_angle:
            raise Refusal(
                "a flight path angle is set in addition to a recorded trajectory",
                "no flight_path_angle, because the recording determines it",
                ("start", "flight_path_angle"),
            )
        return self

    def list_manoeuvres(self) -> "list[tuple[tuple[str | int, ...], float, Any]]":
        """Return the location in the file, start time (s) and model of each manoeuvre, in order."""
        if not isinstance(self.manoeuvre, Phases):
            return [(("manoeuvre",), self.start_time, self.manoeuvre)]
        begin = self.start_time
        manoeuvres: list[tuple[tuple[str | int, ...], float, Any]] = []
        for i, phase in enumerate(self.manoeuvre.phases):
            manoeuvres.append((("manoeuvre", "phases", i), begin, phase))
            begin += phase.length
        return manoeuvres

    def windows(self) -> dict[str, tuple[float, float]]:
        """Return the start and end times (s) of the named phases."""
        named = [
            (begin, manoeuvre)
            for _, begin, manoeuvre in self.list_manoeuvres()
            if getattr(manoeuvre, "name", None) is not None
        ]
        return {manoeuvre.name: (begin, begin + manoeuvre.length) for begin, manoeuvre in named}

    def read_air(self) -> tuple[Floats | None, Floats | None]:
        """Return the wind table and the density table, or None for a table that is not used.

        Raise InputError if a table is invalid.
        """
        wind = self.wind
        density = self.density
        return (
            None
            if isinstance(wind, str)
            else read_air_table(wind.file, WIND, wind.columns, wind.comma),
            None
            if isinstance(density, str)
            else read_air_table(density.file, DENSITIES, density.columns, density.comma),
        )

    def make_air(self) -> Floats:
        """Return the nominal air [level, column]; see :mod:`abhv_mc_vehicle.kernel.plant.air_data`.

        Raise InputError if a table is invalid.
        """
        return join_air(*self.read_air())

    def read_members(self) -> tuple[list[Floats], Floats]:
        """Return the air and the weight of each member of the ensemble, if there is one."""
        own = self.atmosphere
        return read_ensemble(own.ensemble, own.columns, own.comma) if own else ([], np.empty(0))

    def stack_air(self) -> Floats:
        """Return the nominal air, followed by the air of each member of the ensemble.

        Raise InputError if a table is invalid.
        """
        nominal = self.make_air()
        members, _ = self.read_members()
        if members and not len(nominal):  # calm standard air, above all other altitudes
            nominal = np.array([[1e7, 0.0, 0.0, 1.0, 1.0], [2e7, 0.0, 0.0, 1.0, 1.0]])
        blocks = [nominal, *members]
        # The kernel finds the members by the fall of the altitude.
        if self.atmosphere and any(a[-1, 0] <= b[0, 0] for a, b in pairwise(blocks)):
            raise InputError(
                self.atmosphere.ensemble,
                "a member begins above the end of the member, or the nominal air, before it",
                "altitudes that overlap",
            )
        return np.vstack(blocks)

    def find_air_warnings(self, altitude: Floats) -> list[str]:
        """Return warnings about air tables.

        The tables should cover the given altitudes of a flight and be in hydrostatic balance.
        """
        tables = [
            (key.file, table)
            for key, table in zip((self.wind, self.density), self.read_air(), strict=True)
            if not isinstance(key, str) and table is not None
        ]
        if self.atmosphere:  # altitudes that all members have
            members, _ = self.read_members()
            low = max(air[0, 0] for air in members)
            high = min(air[-1, 0] for air in members)
            tables.append((self.atmosphere.ensemble, np.array([[low], [high]])))
        return find_imbalance(self.make_air()) + [
            warning
            for file, table in tables
            for warning in find_air_warnings(Path(file), table, altitude)
        ]

    def make_earth(self) -> Earth:
        """Return the mission's Earth model in the form required by the kernel."""
        if isinstance(self.earth, str):
            return WGS84
        return Earth(**{name: getattr(self.earth, name) for name in EarthNumbers.model_fields})


@made_once
def read_mission(path: str | Path) -> Mission:
    """Read and check a mission file and its tables. Raise InputError if one is invalid."""
    mission = validate(read_document(path), Mission)
    if isinstance(mission.manoeuvre, Recorded):
        read_trajectory(mission.manoeuvre.file, mission.duration)
    mission.stack_air()
    return mission
