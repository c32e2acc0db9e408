"""Reference of a mission at each control tick: commanded motion and nominal controls.

The nominal controls satisfy eq. 12 of Zhu and Shen (2014).

The paper solves its three equations in turn. This method diverges beyond 45 deg of bank, because
each pass multiplies the error by ``-tan^2 bank``. This module solves the first equation in an outer
search. For each trial value, the second equation is solved for the angle of attack; the third
equation gives the bank explicitly.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from abhv_mc.array_types import Floats
from abhv_mc.io.messages import counted, grouped_digits
from abhv_mc_vehicle.control.design.design_cache import cache_results
from abhv_mc_vehicle.control.design.design_model import make_environment_points
from abhv_mc_vehicle.control.design.profile import Profile, make_profile, ramp_times
from abhv_mc_vehicle.control.design.trim_tables import make_trim_tables
from abhv_mc_vehicle.control.mission import Mission
from abhv_mc_vehicle.kernel.laws.columns import REFERENCE
from abhv_mc_vehicle.kernel.laws.trim_lookup import (
    BANK_LIMIT,
    NO_ANGLE_OF_ATTACK,
    NO_BANK,
    NO_ELEVATOR,
    NO_EQUIVALENCE_RATIO,
    TRIM_ROWS,
    Cut,
    GuidancePoints,
    SearchBounds,
    fill_trim,
)
from abhv_mc_vehicle.kernel.plant.vehicle import Tables, Vehicle
from abhv_mc_vehicle.kernel.world.earth import Earth, find_surroundings
from abhv_mc_vehicle.plant.trim import FlightPoint, TrimPoint, nominal_air, trim
from abhv_mc_vehicle.vehicle.actuators import deflection_range


class GuidanceTrim(NamedTuple):
    """Nominal controls along a trajectory, each of shape ``[point]``."""

    angle_of_attack: Floats
    bank: Floats
    equivalence_ratio: Floats
    elevator: Floats
    mass: Floats  # mass at the point, after subtracting the fuel burnt before it
    # sum of flags, such as NO_EQUIVALENCE_RATIO, for controls at a limit; 0 if no flag is set
    status: NDArray[np.int64]


def trim_along(
    vehicle: Vehicle,
    trim_tables: Tables,
    points: GuidancePoints,
    mass: float,
    tick: float = 0.0,
    held_equivalence_ratio: float = -1.0,
    warm_start: bool = True,
) -> GuidanceTrim:
    """Solve equation (12) at each point in order, starting each search at the last solution.

    ``mass`` is the mass at the first point, kg; if ``tick`` (time between points, s) is given, the
    mass decreases by the fuel burnt. A negative ``held_equivalence_ratio`` means that the speed is
    maintained. If the range of a control (trim tables, BANK_LIMIT, the
    elevator's limits) contains no solution, the result is the bound of the range with the smaller
    residual, and a flag is set in the status.
    """
    constants = vehicle.constants
    alpha_nodes, eta_nodes = (
        trim_tables.grid[first : first + length].copy()
        for first, length in zip(
            trim_tables.axis_start[1:3], trim_tables.axis_length[1:3], strict=True
        )
    )
    eta_range = (constants.equivalence_ratio_min, constants.equivalence_ratio_max)
    bounds = SearchBounds(
        float(alpha_nodes[0]),
        float(alpha_nodes[-1]),
        *eta_range,
        *deflection_range(vehicle, 2),
        searches=2,
    )
    points = GuidancePoints(*(np.array(x, np.float64) for x in np.broadcast_arrays(*points)))
    solution = np.empty((points.speed.size, 6))
    rows = len(TRIM_ROWS)
    line = np.empty((alpha_nodes.size, rows))
    cut = Cut(alpha_nodes, eta_nodes, np.empty((eta_nodes.size, alpha_nodes.size, rows)), line)
    fill_trim(
        trim_tables,
        constants,
        points,
        mass,
        tick,
        held_equivalence_ratio,
        warm_start,
        bounds,
        cut,
        solution,
    )
    alpha, bank, eta, elevator, masses, status = np.ascontiguousarray(solution.T)
    return GuidanceTrim(alpha, bank, eta, elevator, masses, status.astype(np.int64))


def trim_faults(trim: GuidanceTrim, times: Floats) -> list[str]:
    """Return a sentence for each equation that has no solution within the limits."""
    sentences = {
        NO_EQUIVALENCE_RATIO: "no throttle within the engine's limits maintains the speed",
        NO_ANGLE_OF_ATTACK: "no angle of attack in the trim tables gives the required lift",
        NO_BANK: f"no bank angle up to {np.rad2deg(BANK_LIMIT):.0f} deg gives the turn rate",
        NO_ELEVATOR: "no elevator deflection within its limits balances the pitching moment",
    }
    faults = []
    for flag, sentence in sentences.items():
        points = np.flatnonzero(trim.status & flag)
        if points.size:
            faults.append(
                f"at {grouped_digits(points.size)} of {counted(times.size, 'point')} of the "
                f"reference, from {times[points[0]]:.2f} s, {sentence}"
            )
    return faults


COLUMN_INDEX = {name: i for i, name in enumerate(REFERENCE)}

_STEADY = 1e-9  # largest change between two points for which the Mach number counts as constant
# time after a ramp or step of the reference that "settled" metrics exclude, s
SETTLING = 5.0
# Trims are cached, because flight plans and steady plans of a campaign start at the same trim.
_trim = cache_results(trim)


@cache_results
def make_mission_trim_tables(mission: Mission, vehicle: Vehicle) -> Tables:
    """Make trim tables for the speeds of the mission, at the middle of its altitude range."""
    profile = make_profile(mission, np.linspace(0.0, mission.duration, 201))
    speeds = (float(profile.speed.min()), float(profile.speed.max()))
    middle_altitude = float(profile.altitude.min() + profile.altitude.max()) / 2.0
    air = mission.make_air()
    mach = profile.speed / nominal_air(air, profile.altitude)[1]
    steady = np.unique(np.round(mach[1:][np.abs(np.diff(mach)) < _STEADY], 6))
    return make_trim_tables(vehicle, middle_altitude, speeds, steady, air)


def transients(mission: Mission) -> tuple[tuple[float, float], ...]:
    """Return the intervals (s) that "settled" metrics exclude: ramps and SETTLING after each."""
    return tuple((first, last + SETTLING) for first, last in ramp_times(mission))


@cache_results
def solve_reference(
    mission: Mission, vehicle: Vehicle, trim_tables: Tables, tick: float, ticks: int
) -> tuple[Floats, GuidanceTrim]:
    """Return the reference ``[tick, column]`` (columns: REFERENCE) and its guidance trim.

    Ticks are numbered from 0 to ``ticks`` and are ``tick`` s apart; at the tick of a step, the
    value after the step is used. The nominal controls apply to a non-rotating Earth, as in equation
    (1).
    """
    fixed_earth = mission.make_earth()._replace(rotation_rate=0.0)
    half_ticks = make_profile(mission, np.arange(2 * ticks + 1, dtype=np.float64) * (0.5 * tick))
    profile = Profile(*(x[::2] for x in half_ticks))
    north, east, latitude = make_track(mission, fixed_earth, half_ticks, tick)
    environment_points = make_environment_points(
        fixed_earth, profile.altitude, latitude, mission.make_air()
    )
    points = GuidancePoints(
        speed=profile.speed,
        latitude=latitude,
        flight_path_angle=profile.flight_path_angle,
        heading=profile.heading,
        axial=profile.speed_rate,
        longitudinal=profile.speed * profile.flight_path_angle_rate,
        lateral=profile.speed * profile.heading_rate,
        **environment_points._asdict(),
    )
    # A glider cannot maintain its speed, so its equivalence ratio is fixed at 0.
    held = -1.0 if vehicle.constants.equivalence_ratio_max > 0.0 else 0.0
    nominal = trim_along(vehicle, trim_tables, points, vehicle.constants.mass_start, tick, held)
    times = np.arange(ticks + 1) * tick
    settled = np.ones(ticks + 1)
    for first, end in transients(mission):
        settled[(times - first > -0.5 * tick) & (times - end < -0.5 * tick)] = 0.0
    count = np.cumsum(settled)
    settled *= count - np.maximum.accumulate(np.where(settled > 0.0, 0.0, count))
    heading = mission.start.heading
    column = {
        **profile._asdict(),
        **nominal._asdict(),
        **environment_points._asdict(),
        "time": times,
        "north": north,
        "east": east,
        "latitude": latitude,
        "settled": settled,
        "track_north": np.full(ticks + 1, np.sin(heading)),
        "track_east": np.full(ticks + 1, -np.cos(heading)),
    }
    return np.ascontiguousarray(np.stack([column[name] for name in REFERENCE], axis=1)), nominal


def make_track(
    mission: Mission, earth: Earth, half_ticks: Profile, tick: float
) -> tuple[Floats, Floats, Floats]:
    """Return north and east position (m) and latitude (rad) at the ticks, by Simpson's rule.

    The positions are integrals of the ground speed at altitude.
    """
    forward = half_ticks.speed * np.cos(half_ticks.flight_path_angle)
    north_speed = forward * np.cos(half_ticks.heading)
    east_speed = forward * np.sin(half_ticks.heading)
    latitude = np.full(north_speed.size, mission.start.latitude)
    for _ in range(
        2
        # The meridian radius varies slowly along the track, so each iteration adds five correct
        # digits.
    ):
        meridian = find_surroundings(earth, 0.0, np.sin(latitude), 1.0).meridian
        on_ticks = mission.start.latitude + _simpson(
            north_speed / (meridian + half_ticks.altitude), tick
        )
        latitude = np.interp(np.arange(latitude.size), np.arange(0, latitude.size, 2), on_ticks)
    return _simpson(north_speed, tick), _simpson(east_speed, tick), on_ticks


def _simpson(rate: Floats, tick: float) -> Floats:
    """Integrate a rate given at half ticks; return the integral at the ticks."""
    return np.concatenate(
        [[0.0], np.cumsum(tick / 6.0 * (rate[:-2:2] + 4.0 * rate[1:-1:2] + rate[2::2]))]
    )


def on_glide_path(mission: Mission, vehicle: Vehicle) -> Mission:
    """Return the mission; a glider without an initial angle starts on its glide path."""
    if vehicle.constants.equivalence_ratio_max > 0.0 or mission.start.flight_path_angle:
        return mission
    angle = make_start_trim(mission, vehicle).flight_path_angle
    start = mission.start.model_copy(update={"flight_path_angle": angle})
    return mission.model_copy(update={"start": start})


def make_start_point(mission: Mission) -> FlightPoint:
    """Return the flight condition at the mission's start, in the mission's nominal air."""
    start = mission.start
    return FlightPoint(
        start.altitude,
        start.speed,
        start.bank,
        start.latitude,
        start.heading,
        start.flight_path_angle,
        air=mission.make_air(),
    )


def make_start_trim(
    mission: Mission,
    vehicle: Vehicle,
    push: tuple[float, float, float] = (0.0, 0.0, 0.0),
    rotating: bool = False,
) -> TrimPoint:
    """Return the trim at the mission's start, for the full tables.

    ``push`` contains the forces and moment of custom dynamics, as in :class:`FlightPoint`. Unless
    ``rotating``, the Earth does not rotate.
    """
    earth = mission.make_earth()
    earth = earth if rotating else earth._replace(rotation_rate=0.0)
    return _trim(vehicle, earth, make_start_point(mission)._replace(push=push))
