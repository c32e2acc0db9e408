"""Two engines of 89 kN each at sea level."""

from abhv_mc.extend import Thrust, power


def thrust(air, throttle, settings):
    """Return a thrust that decreases with the density of the air."""
    return Thrust(force_x=throttle * 178e3 * power(air.density / 1.225, 0.7))
