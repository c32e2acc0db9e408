"""Air data and table variables, computed in the first loop of an integrator stage.

A mission may define its nominal air by a table of wind and of factors on the standard density over
altitude. The tables of an ensemble's members follow in the same array. The density factor is
constant over a control tick, like the factor of a dispersed profile.
"""

import math

import numpy as np

from abhv_mc.array_types import Floats
from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import (
    is_shallow,
    larger,
    reciprocals,
    shallow_angles,
    sincos,
    two_angles,
)
from abhv_mc_vehicle.kernel.numerics.quaternion import (
    quaternion_at,
    rotate_meridional,
    rotate_to_body,
)
from abhv_mc_vehicle.kernel.numerics.tables import natural
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.disturbance import any_lane
from abhv_mc_vehicle.kernel.plant.state import XS, X, parameter_rows
from abhv_mc_vehicle.kernel.world.atmosphere import (
    GAS_CONSTANT,
    HEAT_CAPACITY_RATIO,
    atmosphere_lanes,
    warm_pressure,
)

# Units are m, m/s towards north and east, and factors on the standard atmosphere.
# The density factor includes the effect of the temperature factor.
PROFILE = (
    "altitude",
    "wind_north",
    "wind_east",
    "density",
    "temperature",
)
_ALTITUDE, _NORTH, _EAST, _DENSITY, _TEMPERATURE = range(5)
_COLDEST = -160.0  # limit of the offset of a column, which keeps all temperatures positive, K
_WARMER, _COLUMN, _MEMBER = parameter_rows("atmosphere.temperature", 3)


@scalar
def flow_direction(u, v, w):
    """Return V, 1 / V, sin alpha, cos alpha, sin beta and cos beta of a body-axis velocity.

    At rest both angles and 1 / V are zero, so a sphere that is dropped from rest needs no special
    treatment.
    """
    in_plane_squared = u * u + w * w
    speed = math.sqrt(in_plane_squared + v * v)
    in_plane = math.sqrt(in_plane_squared)
    per_in_plane, per_speed = reciprocals(
        in_plane if in_plane > 0.0 else 1.0, speed if speed > 0.0 else 1.0
    )
    cos_alpha = u * per_in_plane if in_plane > 0.0 else 1.0
    cos_beta = in_plane * per_speed if speed > 0.0 else 1.0
    return (
        speed,
        per_speed if speed > 0.0 else 0.0,
        w * per_in_plane,
        cos_alpha,
        v * per_speed,
        cos_beta,
    )


@lanes
def flow_angles(Z, width, alpha_row, beta_row):
    """Compute angle of attack and sideslip from the sines and cosines of the air data.

    Both angles are usually within pi/8, where a faster function gives the same results.
    """
    is_large = False
    for lane in range(width):
        shallow = is_shallow(Z[s.SIN_ALPHA, lane], Z[s.COS_ALPHA, lane]) and is_shallow(
            Z[s.SIN_BETA, lane], Z[s.COS_BETA, lane]
        )
        is_large |= not shallow
    if is_large:
        for lane in range(width):
            Z[alpha_row, lane], Z[beta_row, lane] = two_angles(
                Z[s.SIN_ALPHA, lane], Z[s.COS_ALPHA, lane], Z[s.SIN_BETA, lane], Z[s.COS_BETA, lane]
            )
    else:
        for lane in range(width):
            Z[alpha_row, lane], Z[beta_row, lane] = shallow_angles(
                Z[s.SIN_ALPHA, lane], Z[s.COS_ALPHA, lane], Z[s.SIN_BETA, lane], Z[s.COS_BETA, lane]
            )


@lanes
def move_air(Z, width, profile):
    """Compute the velocity of the air at the stage's state ``XS``.

    The velocity is the sum of a wind linear in altitude, the gusts of the tick, and the wind of the
    profile.
    """
    for lane in range(width):
        altitude = Z[XS + s.ALTITUDE, lane]
        wind_n = Z[s.K_WIND_NORTH, lane] + Z[s.K_SHEAR_NORTH, lane] * altitude
        wind_e = Z[s.K_WIND_EAST, lane] + Z[s.K_SHEAR_EAST, lane] * altitude
        u, v, w = wind_in_body(Z, lane, wind_n, wind_e)
        Z[s.AIR_U, lane], Z[s.AIR_V, lane] = u + Z[s.GUST_U, lane], v + Z[s.GUST_V, lane]
        Z[s.AIR_W, lane] = w + Z[s.GUST_W, lane]
    if profile.shape[0] > 0:
        for lane in range(width):
            altitude = Z[XS + s.ALTITUDE, lane]
            knot, share = find_knot(Z, lane, profile, altitude)
            north = between_knots(profile, _NORTH, knot, share)
            east = between_knots(profile, _EAST, knot, share)
            u, v, w = wind_in_body(Z, lane, north, east)
            Z[s.AIR_U, lane] += u
            Z[s.AIR_V, lane] += v
            Z[s.AIR_W, lane] += w


@lanes
def wind_in_body(Z, lane, north, east):
    """Return the body components of a horizontal wind at the attitude of the stage."""
    q0, q1, q2, q3 = quaternion_at(Z, XS + s.Q0, lane)
    return rotate_to_body(q0, q1, q2, q3, north, east, 0.0)


def no_profile() -> Floats:
    """Return a profile without knots, which represents calm standard air."""
    return np.empty((0, len(PROFILE)))


@lanes
def choose_member(Z, width, profile):
    """Find the knots of each flight's air: those of the mission, or of its ensemble member.

    The altitude falls from the last knot of a member to the first knot of the next. The last member
    replaces one that does not exist.
    """
    for lane in range(width):
        first = 0
        member = 0.0
        last = profile.shape[0]
        for knot in range(1, last):
            if profile[knot, _ALTITUDE] < profile[knot - 1, _ALTITUDE]:
                if member >= Z[_MEMBER, lane]:
                    last = knot
                    break
                first = knot
                member = member + 1.0
        Z[s.FIRST_KNOT, lane] = float(first)
        Z[s.INTERVALS, lane] = float(last - 1 - first)


@lanes
def find_knot(Z, lane, profile, altitude):
    """Return the knot at or below an altitude, and the share of the interval above it.

    The share is 0 or 1 beyond the ends.
    """
    knot = natural(int(Z[s.FIRST_KNOT, lane]))
    count = natural(int(Z[s.INTERVALS, lane]))
    while count > 1:  # number of intervals, halved in each iteration
        half = count // 2
        knot = knot + half if altitude > profile[knot + half, _ALTITUDE] else knot
        count -= half
    low = profile[knot, _ALTITUDE]
    high = profile[knot + 1, _ALTITUDE]
    share = (altitude - low) / (high - low)
    share = 1.0 if share > 1.0 else share
    return knot, share if altitude > low else 0.0


@lanes
def between_knots(profile, column, knot, share):
    """Interpolate a column linearly between a knot and the next."""
    low = profile[knot, column]
    return low + share * (profile[knot + 1, column] - low)


@lanes
def nominal_density(Z, width, profile):
    """Multiply the tick's density factor by the profile's; set the temperature factor.

    The density factor includes the pressure of a column with a uniform temperature offset.
    """
    if any_lane(Z, width, _COLUMN, 1, 0.0):
        for lane in range(width):
            offset = larger(Z[_COLUMN, lane], _COLDEST)
            Z[s.DENSITY_PROFILE, lane] *= warm_pressure(Z[X + s.ALTITUDE, lane], offset)
    if profile.shape[0] > 0:
        for lane in range(width):
            altitude = Z[X + s.ALTITUDE, lane]
            knot, share = find_knot(Z, lane, profile, altitude)
            Z[s.DENSITY_PROFILE, lane] *= between_knots(profile, _DENSITY, knot, share)
            Z[s.TEMPERATURE_PROFILE, lane] = between_knots(profile, _TEMPERATURE, knot, share)


@lanes
def is_warm(Z, width, profile):
    """Return whether any flight has a non-standard temperature; this never changes in flight."""
    differs = False
    for knot in range(profile.shape[0]):
        differs |= profile[knot, _TEMPERATURE] != 1.0
    return differs or any_lane(Z, width, _WARMER, 2, 0.0)


@lanes
def warm_air(Z, width, density_row, per_sound_row):
    """Apply the profile's temperature and the flight's offsets to density and sound speed.

    The density already includes the temperature of the profile. The pressure does not change. The
    offsets cannot reduce the temperature to less than a tenth of its value.
    """
    for lane in range(width):
        per_sound = Z[per_sound_row, lane]
        factor = Z[s.TEMPERATURE_PROFILE, lane]
        share = (Z[_WARMER, lane] + Z[_COLUMN, lane]) * (per_sound * per_sound) / factor
        ratio = larger(1.0 + HEAT_CAPACITY_RATIO * GAS_CONSTANT * share, 0.1)
        Z[density_row, lane] /= ratio
        Z[per_sound_row, lane] = per_sound / math.sqrt(factor * ratio)


@lanes
def air_data(Z, width, vehicle, earth, warm):
    """Compute air data and table variables at the stage's state ``XS``, with dispersions.

    ``warm`` is the result of :func:`is_warm`. Damping terms use the body rates relative to the air,
    including the Earth's rotation and rotary gusts.
    """
    constants = vehicle.constants
    # The row of the Mach number contains 1 / speed of sound until the airspeed is known.
    atmosphere_lanes(Z, width, XS + s.ALTITUDE, s.RHO, s.V_MACH)
    if warm:
        warm_air(Z, width, s.RHO, s.V_MACH)
    for lane in range(width):
        q0, q1, q2, q3 = quaternion_at(Z, XS + s.Q0, lane)
        altitude = Z[XS + s.ALTITUDE, lane]
        speed, per_speed, sin_alpha, cos_alpha, sin_beta, cos_beta = flow_direction(
            Z[XS + s.U, lane] - Z[s.AIR_U, lane],
            Z[XS + s.V, lane] - Z[s.AIR_V, lane],
            Z[XS + s.W, lane] - Z[s.AIR_W, lane],
        )
        rho = Z[s.RHO, lane] * (Z[s.K_DENSITY, lane] * Z[s.DENSITY_PROFILE, lane])
        Z[s.RHO, lane] = rho
        Z[s.Q_BAR, lane] = 0.5 * rho * speed * speed
        Z[s.AIRSPEED, lane] = speed
        Z[s.SIN_ALPHA, lane] = sin_alpha
        Z[s.COS_ALPHA, lane] = cos_alpha
        Z[s.SIN_BETA, lane] = sin_beta
        Z[s.COS_BETA, lane] = cos_beta
        sin_lat, cos_lat = sincos(Z[XS + s.LATITUDE, lane])
        earth_x, earth_y, earth_z = rotate_meridional(
            q0, q1, q2, q3, earth.rotation_rate * cos_lat, -earth.rotation_rate * sin_lat
        )
        Z[s.SIN_LAT, lane] = sin_lat
        Z[s.COS_LAT, lane] = cos_lat
        Z[s.EARTH_X, lane] = earth_x
        Z[s.EARTH_Y, lane] = earth_y
        Z[s.EARTH_Z, lane] = earth_z
        half_inverse = 0.5 * per_speed if speed > 1e-9 else 0.0
        Z[s.V_ONE, lane] = 1.0
        Z[s.V_MACH, lane] = speed * Z[s.V_MACH, lane]
        Z[s.V_P_HAT, lane] = (
            (Z[XS + s.ROLL_RATE, lane] - earth_x - Z[s.GUST_P, lane])
            * constants.span
            * half_inverse
        )
        Z[s.V_Q_HAT, lane] = (
            (Z[XS + s.PITCH_RATE, lane] - earth_y - Z[s.GUST_Q, lane])
            * constants.chord
            * half_inverse
        )
        Z[s.V_R_HAT, lane] = (
            (Z[XS + s.YAW_RATE, lane] - earth_z - Z[s.GUST_R, lane]) * constants.span * half_inverse
        )
        Z[s.V_ALTITUDE, lane] = altitude
        Z[s.V_MASS, lane] = Z[XS + s.MASS, lane] * Z[s.PER_MASS_FACTOR, lane]
    flow_angles(Z, width, s.V_ALPHA, s.V_BETA)


@lanes
def deflections(Z, width):
    """Compute effective deflections and equivalence ratio at the stage."""
    for lane in range(width):
        Z[s.V_DELTA_A, lane] = Z[s.EFFECT, lane] * Z[XS + s.AILERON, lane]
        Z[s.V_DELTA_R, lane] = Z[s.EFFECT + 1, lane] * Z[XS + s.RUDDER, lane]
        Z[s.V_DELTA_E, lane] = Z[s.EFFECT + 2, lane] * Z[XS + s.ELEVATOR, lane]
        Z[s.V_ETA, lane] = Z[XS + s.ETA, lane]
