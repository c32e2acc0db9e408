"""Commanded altitude, speed and heading over a mission, with their rates."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.flights.robustness import find_steps
from abhv_mc_vehicle.control import mission as m
from abhv_mc_vehicle.control.mission_tables import read_trajectory


class Profile(NamedTuple):
    """Commanded motion, in SI units and radians; each field has shape ``[time]``."""

    altitude: Floats
    altitude_rate: Floats
    flight_path_angle: Floats
    flight_path_angle_rate: Floats
    speed: Floats
    speed_rate: Floats
    heading: Floats
    heading_rate: Floats


def ramp_times(mission: m.Mission) -> tuple[tuple[float, float], ...]:
    """Return the start and end times (s) of the bank ramps within the mission.

    An S manoeuvre has a ramp at each end; the ramp of a step has zero length.
    """
    return tuple(
        (first, first + manoeuvre.bank_time)
        for _, begin, manoeuvre in mission.list_manoeuvres()
        if isinstance(manoeuvre, m.SManoeuvre)
        for first in (begin, begin + manoeuvre.length - manoeuvre.bank_time)
        if first <= mission.duration
    )


def step_times(mission: m.Mission, reference: str) -> list[float]:
    """Return the times (s) at which steps and ramps of a reference end.

    The reference is 'transients' for the bank angle, or a channel of a quantity of the profile.
    """
    if reference == "transients":
        return [end for _, end in ramp_times(mission)]
    times = np.arange(0.0, mission.duration, 0.01)
    profile = make_profile(mission, times)
    values = getattr(profile, reference.partition("_reference_")[0], np.zeros(times.size))
    return [float(time) for time in times[find_steps(values) > 0.0]]


def make_profile(mission: m.Mission, times: Floats) -> Profile:
    """Return the commanded motion, the sum of all manoeuvres, at evenly spaced times from 0.

    At the time of a step, the value after the step is used.
    """
    if isinstance(mission.manoeuvre, m.Recorded):
        return _recorded(mission.manoeuvre, mission.duration, times)
    start = mission.start
    ones = np.ones_like(times)
    # rows of each array: the quantity and its rate; for altitude, also the acceleration
    altitude = np.outer([start.altitude, 0.0, 0.0], ones)
    speed, heading, path = (
        np.outer([value, 0.0], ones)
        for value in (start.speed, start.heading, start.flight_path_angle)
    )
    speed_now = start.speed
    path_now = start.flight_path_angle

    for _, begin, manoeuvre in mission.list_manoeuvres():
        since = times - begin
        if isinstance(manoeuvre, m.SManoeuvre):
            lateral, lateral_rate = (
                motion / speed_now for motion in manoeuvre.lateral_motion(since)
            )
            heading = heading - np.stack(
                [np.arcsin(lateral), lateral_rate / np.sqrt(1.0 - lateral**2)]
            )
        elif isinstance(manoeuvre, m.Turn):
            heading = heading + manoeuvre.heading_change * _smooth(since, manoeuvre.length)[:2]
        elif isinstance(manoeuvre, m.Waypoints):
            for turn in manoeuvre.turns:
                heading = heading + turn.heading_change * _smooth(since - turn.at, turn.length)[:2]
        elif isinstance(manoeuvre, m.Climb):
            change = _smooth(since, manoeuvre.length)
            altitude = altitude + manoeuvre.altitude_change * change
            speed = speed + manoeuvre.speed_change * change[:2]
            speed_now += manoeuvre.speed_change
        elif isinstance(manoeuvre, m.PullUp):
            path = (
                path
                + (manoeuvre.flight_path_angle - path_now) * _smooth(since, manoeuvre.length)[:2]
            )
            path_now = manoeuvre.flight_path_angle

    if path[0].any():
        climb_rate = speed[0] * np.sin(path[0])
        climb_acceleration = speed[0] * np.cos(path[0]) * path[1] + speed[1] * np.sin(path[0])
        altitude = altitude + np.stack(
            [_integral(times, climb_rate, climb_acceleration), climb_rate, climb_acceleration]
        )
    return _complete(altitude, speed, heading)


def _recorded(recorded: m.Recorded, duration: float, times: Floats) -> Profile:
    from scipy.interpolate import CubicSpline

    samples = read_trajectory(recorded.file, duration)
    values = samples[:, 1:].T
    altitude, speed, heading = (
        np.stack([CubicSpline(samples[:, 0], value)(times, order) for order in range(3)])
        for value in values
    )
    return _complete(altitude, speed[:2], heading[:2])


def _complete(altitude: Floats, speed: Floats, heading: Floats) -> Profile:
    """Return the profile with the flight path angle that follows from the climb rate."""
    climb, climb_rate = altitude[1:]
    gamma = np.arcsin(np.clip(climb / speed[0], -1.0, 1.0))
    gamma_rate = (climb_rate - speed[1] * np.sin(gamma)) / (speed[0] * np.cos(gamma))
    return Profile(altitude[0], climb, gamma, gamma_rate, *speed, *heading)


def _smooth(since: Floats, length: float) -> Floats:
    """Return value, rate and acceleration of a smooth change from 0 to 1 over ``length`` s."""
    phase = 2.0 * np.pi * np.clip(since / length, 0.0, 1.0)
    rate = (1.0 - np.cos(phase)) / length
    return np.stack(
        [(phase - np.sin(phase)) / (2.0 * np.pi), rate, 2.0 * np.pi * np.sin(phase) / length**2]
    )


def _integral(times: Floats, rate: Floats, acceleration: Floats) -> Floats:
    """Return the integral from the first time, by the end-corrected trapezoidal rule."""
    h = np.diff(times)
    parts = h * (rate[:-1] + rate[1:]) / 2.0 + h**2 * (acceleration[:-1] - acceleration[1:]) / 12.0
    return np.concatenate([[0.0], np.cumsum(parts)])
