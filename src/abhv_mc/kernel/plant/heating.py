"""Heat flux at the stagnation point: Sutton and Graves, NASA TR R-376 (1971), for the Earth's air."""

import math

from abhv_mc.kernel.jit import scalar

_SUTTON_GRAVES = 1.7415e-4  # kg^0.5/m


@scalar
def heat_flux(density, airspeed, nose_radius):
    """W/m2 at a nose of a radius (m), cold wall: k sqrt(density / radius) V^3; not a number without a radius."""
    cubed = airspeed * airspeed * airspeed
    known = nose_radius > 0.0
    return _SUTTON_GRAVES * math.sqrt(density / (nose_radius if known else 1.0)) * cubed if known else math.nan
