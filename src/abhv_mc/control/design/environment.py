"""Air and Earth at places of the reference, for design work."""

from typing import NamedTuple

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.control.design.design_model import Environment
from abhv_mc.kernel.world.atmosphere import atmosphere
from abhv_mc.kernel.world.earth import Earth, gravity_ned, radii

_RISE = 1.0  # m, half step of the slopes over altitude


class Places(NamedTuple):
    """Air and Earth, each ``[place]``, SI."""

    density: Floats
    sound_speed: Floats
    gravity: Floats  # down component
    radius: Floats  # M + h


def density_factor(air: Floats, altitude: Floats) -> Floats:
    """Factor on the standard density of a mission's nominal air (:mod:`abhv_mc.kernel.plant.air_profile`)."""
    return np.interp(altitude, air[:, 0], air[:, 3]) if len(air) else np.ones_like(altitude)


def make_places(earth: Earth, altitude: Floats, latitude: Floats, air: Floats | None = None) -> Places:
    """Air, gravity and radius at geodetic altitudes (m) and latitudes (rad); ``air``: the mission's, not standard."""
    result = np.empty((4, altitude.size))
    for i, (height, angle) in enumerate(zip(altitude, latitude, strict=True)):
        sine, cosine = np.sin(angle), np.cos(angle)
        density, _, _, sound_speed = atmosphere(height)
        result[:, i] = density, sound_speed, gravity_ned(earth, height, sine, cosine)[1], radii(earth, sine)[0] + height
    if air is not None and len(air):
        result[0] *= density_factor(air, altitude)
    return Places(*result)


def make_environment(earth: Earth, altitude: float, latitude: float, air: Floats | None = None) -> Environment:
    """Air and Earth at one place with their slopes over altitude."""
    low, here, high = (
        make_places(earth, np.array([altitude + rise]), np.array([latitude]), air) for rise in (-_RISE, 0.0, _RISE)
    )

    def slope(name: str) -> float:
        return float((getattr(high, name)[0] - getattr(low, name)[0]) / (2.0 * _RISE))

    return Environment(
        altitude,
        float(here.density[0]),
        float(here.sound_speed[0]),
        float(here.gravity[0]),
        float(here.radius[0]),
        latitude,
        slope("density"),
        slope("sound_speed"),
        slope("gravity"),
    )
