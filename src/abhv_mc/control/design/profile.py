"""Commanded altitude, speed and heading over the time of a mission, with their rates."""

from typing import NamedTuple

import numpy as np

from abhv_mc.control import mission as m
from abhv_mc.control.trajectory_file import read_trajectory
from abhv_mc.vehicle.arrays import Floats

_SAME_TIME = 1e-9  # s: a tick that close to a step of the reference is on it


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


def step_times(mission: m.Mission) -> tuple[float, ...]:
    """When the reference's acceleration steps, s; those within the mission."""
    if not isinstance(mission.manoeuvre, m.SManoeuvre):
        return ()
    steps = (mission.start_time, mission.start_time + mission.manoeuvre.length)
    return tuple(step for step in steps if step <= mission.duration)


def make_profile(mission: m.Mission, times: Floats) -> Profile:
    """The mission's motion at evenly spaced times from 0; at a step the value is the one right of it.

    Only the pull-up integrates: its altitude comes from the trapezoidal rule with the slopes' correction (order 4).
    """
    start, manoeuvre = mission.start, mission.manoeuvre
    nothing = np.zeros_like(times)
    altitude, climb, climb_rate = start.altitude + nothing, nothing, nothing
    speed, speed_rate = start.speed + nothing, nothing
    heading, heading_rate = start.heading + nothing, nothing
    since = times - mission.start_time

    if isinstance(manoeuvre, m.SManoeuvre):
        wave = np.pi / manoeuvre.length
        inside = (since >= -_SAME_TIME) & (since < manoeuvre.length - _SAME_TIME)
        sideways = np.where(inside, 0.5 * manoeuvre.offset * wave * np.sin(wave * since), 0.0) / start.speed
        sideways_rate = np.where(inside, 0.5 * manoeuvre.offset * wave**2 * np.cos(wave * since), 0.0) / start.speed
        heading = start.heading - np.arcsin(sideways)
        heading_rate = -sideways_rate / np.sqrt(1.0 - sideways**2)
    elif isinstance(manoeuvre, m.Turn):
        part, rate, _ = _smooth(since, manoeuvre.length)
        heading = start.heading + manoeuvre.heading_change * part
        heading_rate = manoeuvre.heading_change * rate
    elif isinstance(manoeuvre, m.Waypoints):
        for turn in manoeuvre.turns:
            part, rate, _ = _smooth(since - turn.at, turn.length)
            heading = heading + turn.heading_change * part
            heading_rate = heading_rate + turn.heading_change * rate
    elif isinstance(manoeuvre, m.Climb):
        part, rate, acceleration = _smooth(since, manoeuvre.length)
        altitude = start.altitude + manoeuvre.altitude_change * part
        climb, climb_rate = manoeuvre.altitude_change * rate, manoeuvre.altitude_change * acceleration
        speed, speed_rate = start.speed + manoeuvre.speed_change * part, manoeuvre.speed_change * rate
    elif isinstance(manoeuvre, m.PullUp):
        part, rate, _ = _smooth(since, manoeuvre.length)
        gamma, gamma_rate = manoeuvre.flight_path_angle * part, manoeuvre.flight_path_angle * rate
        climb, climb_rate = start.speed * np.sin(gamma), start.speed * np.cos(gamma) * gamma_rate
        altitude = start.altitude + _integral(times, climb, climb_rate)
    elif isinstance(manoeuvre, m.Recorded):
        from scipy.interpolate import CubicSpline

        samples = read_trajectory(manoeuvre.file, mission.duration)
        height, airspeed = CubicSpline(samples[:, 0], samples[:, 1]), CubicSpline(samples[:, 0], samples[:, 2])
        course = CubicSpline(samples[:, 0], np.deg2rad(samples[:, 3]))
        altitude, climb, climb_rate = height(times), height(times, 1), height(times, 2)
        speed, speed_rate = airspeed(times), airspeed(times, 1)
        heading, heading_rate = course(times), course(times, 1)

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
