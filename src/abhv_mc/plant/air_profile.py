"""The mission's nominal air: wind and a factor on the standard density over altitude, from a table.

Taken once a control tick and held over it. Without a table nothing is computed.
"""

import numpy as np

from abhv_mc.jit import lanes
from abhv_mc.numerics.quaternion import rotate_to_body
from abhv_mc.plant import state as s
from abhv_mc.plant.state import X
from abhv_mc.vehicle.arrays import Floats

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
def nominal_air(Z, width, profile):
    """Add the profile's wind to the air's motion of the tick, in body axes, and multiply the density's factor."""
    if profile.shape[0] > 0:
        for lane in range(width):
            altitude = Z[X + s.ALTITUDE, lane]
            u, v, w = rotate_to_body(
                Z[X + s.Q0, lane],
                Z[X + s.Q1, lane],
                Z[X + s.Q2, lane],
                Z[X + s.Q3, lane],
                between_knots(profile, _NORTH, altitude),
                between_knots(profile, _EAST, altitude),
                0.0,
            )
            Z[s.GUST_U, lane] += u
            Z[s.GUST_V, lane] += v
            Z[s.GUST_W, lane] += w
            Z[s.DENSITY_PROFILE, lane] *= between_knots(profile, _DENSITY, altitude)
