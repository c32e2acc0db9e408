"""Thrust of two engines with 89 kN each at sea level."""

from abhv_mc.extend import Thrust, power


def thrust(air, throttle, settings):
    """Return the thrust, which decreases as the air density decreases."""
    return Thrust(force_x=throttle * 178e3 * power(air.density / 1.225, 0.7))
