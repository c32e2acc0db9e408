"""Wind over the ground. Gusts and turbulence, when they come, are added to what this returns."""

from abhv_mc.jit import scalar


@scalar
def wind_ned(altitude: float, north: float, east: float, shear_north: float, shear_east: float) -> tuple[float, float]:
    """(north, east), m/s, that the air blows towards: steady, and linear in the altitude (m) above zero.

    ``north`` and ``east`` are the wind at altitude 0; the shears are in 1/s.
    """
    return north + shear_north * altitude, east + shear_east * altitude
