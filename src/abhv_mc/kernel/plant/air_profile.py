"""The mission's nominal air: wind and a factor on the standard density over altitude, from a table.

Without a table nothing is computed. The density's factor is held over a control tick, as a dispersed profile's is.
"""

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc.kernel.jit import lanes
from abhv_mc.kernel.numerics.quaternion import rotate_to_body
from abhv_mc.kernel.plant import state as s
from abhv_mc.kernel.plant.state import XS, X

PROFILE = ("altitude", "wind_north", "wind_east", "density")  # m, m/s towards north and east, factor
_ALTITUDE, _NORTH, _EAST, _DENSITY = range(4)


def no_profile() -> Floats:
    """Still standard air: no knots."""
    return np.empty((0, len(PROFILE)))


@lanes
def between_knots(profile, column, altitude):
    """A column at an altitude: linear between the knots, constant beyond them."""
    value = profile[0, column]
    for knot in range(profile.shape[0] - 1):
        low, high = profile[knot, _ALTITUDE], profile[knot + 1, _ALTITUDE]
        share = (altitude - low) / (high - low)
        share = 1.0 if share > 1.0 else share
        here = profile[knot, column] + share * (profile[knot + 1, column] - profile[knot, column])
        value = here if altitude > low else value
    return value


@lanes
def nominal_density(Z, width, profile):
    """Multiply the factor on the density of the tick by the profile's."""
    if profile.shape[0] > 0:
        for lane in range(width):
            Z[s.DENSITY_PROFILE, lane] *= between_knots(profile, _DENSITY, Z[X + s.ALTITUDE, lane])


@lanes
def nominal_wind(Z, width, profile):
    """Add the profile's wind to the velocity of the air at the stage's state ``XS``."""
    if profile.shape[0] > 0:
        for lane in range(width):
            altitude = Z[XS + s.ALTITUDE, lane]
            north, east = between_knots(profile, _NORTH, altitude), between_knots(profile, _EAST, altitude)
            q0, q1, q2, q3 = Z[XS + s.Q0, lane], Z[XS + s.Q1, lane], Z[XS + s.Q2, lane], Z[XS + s.Q3, lane]
            u, v, w = rotate_to_body(q0, q1, q2, q3, north, east, 0.0)
            Z[s.AIR_U, lane] += u
            Z[s.AIR_V, lane] += v
            Z[s.AIR_W, lane] += w
