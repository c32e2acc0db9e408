"""Commanded altitude, speed and heading over the time of a mission, with their rates."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control import mission as m
from abhv_mc.control.mission_tables import read_trajectory


class Profile(NamedTuple):
    """The wanted motion, each ``[time]``, SI and radians."""

    altitude: Floats
    altitude_rate: Floats
    flight_path_angle: Floats
    flight_path_angle_rate: Floats
    speed: Floats
    speed_rate: Floats
    heading: Floats
    heading_rate: Floats


def ramp_times(mission: m.Mission) -> tuple[tuple[float, float], ...]:
    """From when to when (s) an S establishes its bank and leaves it: a step lasts no time. Those within the mission."""
    return tuple(
        (first, first + manoeuvre.bank_time)
        for _, begin, manoeuvre in mission.moves()
        if isinstance(manoeuvre, m.SManoeuvre)
        for first in (begin, begin + manoeuvre.length - manoeuvre.bank_time)
        if first <= mission.duration
    )


def make_profile(mission: m.Mission, times: Floats) -> Profile:
    """The mission's motion at evenly spaced times from 0, manoeuvres added up; at a step the value right of it."""
    if isinstance(mission.manoeuvre, m.Recorded):
        return _recorded(mission.manoeuvre, mission.duration, times)
    start = mission.start
    nothing = np.zeros_like(times)
    altitude, climb, climb_rate = start.altitude + nothing, nothing, nothing
    speed, speed_rate, speed_now = start.speed + nothing, nothing, start.speed
    heading, heading_rate = start.heading + nothing, nothing
    path, path_rate, path_now = start.flight_path_angle + nothing, nothing, start.flight_path_angle

    for _, begin, manoeuvre in mission.moves():
        since = times - begin
        if isinstance(manoeuvre, m.SManoeuvre):
            sideways, sideways_rate = (part / speed_now for part in manoeuvre.lateral_motion(since))
            heading = heading - np.arcsin(sideways)
            heading_rate = heading_rate - sideways_rate / np.sqrt(1.0 - sideways**2)
        elif isinstance(manoeuvre, m.Turn):
            heading, heading_rate = _turned(heading, heading_rate, manoeuvre, since)
        elif isinstance(manoeuvre, m.Waypoints):
            for turn in manoeuvre.turns:
                heading, heading_rate = _turned(heading, heading_rate, turn, since - turn.at)
        elif isinstance(manoeuvre, m.Climb):
            part, rate, acceleration = _smooth(since, manoeuvre.length)
            altitude = altitude + manoeuvre.altitude_change * part
            climb = climb + manoeuvre.altitude_change * rate
            climb_rate = climb_rate + manoeuvre.altitude_change * acceleration
            speed, speed_rate = speed + manoeuvre.speed_change * part, speed_rate + manoeuvre.speed_change * rate
            speed_now += manoeuvre.speed_change
        elif isinstance(manoeuvre, m.PullUp):
            part, rate, _ = _smooth(since, manoeuvre.length)
            change, path_now = manoeuvre.flight_path_angle - path_now, manoeuvre.flight_path_angle
            path, path_rate = path + change * part, path_rate + change * rate

    if path.any():
        held, held_rate = speed * np.sin(path), speed * np.cos(path) * path_rate + speed_rate * np.sin(path)
        altitude = altitude + _integral(times, held, held_rate)
        climb, climb_rate = climb + held, climb_rate + held_rate
    return _complete(altitude, climb, climb_rate, speed, speed_rate, heading, heading_rate)


def _turned(
    heading: Floats, heading_rate: Floats, turn: m.Turn | m.WaypointTurn, since: Floats
) -> tuple[Floats, Floats]:
    part, rate, _ = _smooth(since, turn.length)
    return heading + turn.heading_change * part, heading_rate + turn.heading_change * rate


def _recorded(recorded: m.Recorded, duration: float, times: Floats) -> Profile:
    from scipy.interpolate import CubicSpline

    samples = read_trajectory(recorded.file, duration)
    height, airspeed = CubicSpline(samples[:, 0], samples[:, 1]), CubicSpline(samples[:, 0], samples[:, 2])
    course = CubicSpline(samples[:, 0], np.deg2rad(samples[:, 3]))
    motion = height(times), height(times, 1), height(times, 2), airspeed(times), airspeed(times, 1)
    return _complete(*motion, course(times), course(times, 1))


def _complete(
    altitude: Floats,
    climb: Floats,
    climb_rate: Floats,
    speed: Floats,
    speed_rate: Floats,
    heading: Floats,
    heading_rate: Floats,
) -> Profile:
    """The profile with the flight path angle that belongs to the climb."""
    gamma = np.arcsin(np.clip(climb / speed, -1.0, 1.0))
    gamma_rate = (climb_rate - speed_rate * np.sin(gamma)) / (speed * np.cos(gamma))
    return Profile(altitude, climb, gamma, gamma_rate, speed, speed_rate, heading, heading_rate)


def _smooth(since: Floats, length: float) -> tuple[Floats, Floats, Floats]:
    """A change from 0 to 1 over ``length`` s: share, rate and acceleration; the acceleration is continuous."""
    phase = 2.0 * np.pi * np.clip(since / length, 0.0, 1.0)
    rate = (1.0 - np.cos(phase)) / length
    return (phase - np.sin(phase)) / (2.0 * np.pi), rate, 2.0 * np.pi * np.sin(phase) / length**2


def _integral(times: Floats, rate: Floats, acceleration: Floats) -> Floats:
    """Integral from the first time: trapezoidal rule with the end slopes' correction, order 4."""
    h = np.diff(times)
    parts = h * (rate[:-1] + rate[1:]) / 2.0 + h**2 * (acceleration[:-1] - acceleration[1:]) / 12.0
    return np.concatenate([[0.0], np.cumsum(parts)])
