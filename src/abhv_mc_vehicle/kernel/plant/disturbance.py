"""Gusts, turbulence and density profile of each flight, constant over a control tick.

Without disturbances, all added values are 0 and all factors are 1, so the results of the flight are
unchanged bit for bit.
"""

import math
from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.numerics.quaternion import quaternion_at, rotate_to_body
from abhv_mc_vehicle.kernel.numerics.random_numbers import (
    M1,
    M2,
    N_STREAM_ROWS,
    next_uniform,
    normal_pair,
    seed_word,
)
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import FILTERS, TURBULENCE, X, parameter_row
from abhv_mc_vehicle.kernel.plant.vehicle import DENSITY_KNOTS_KM
from abhv_mc_vehicle.kernel.world.turbulence import (
    dryden_first,
    dryden_second,
    dryden_second_output,
    follow,
    one_minus_cosine,
    roll_gust_sigma,
)

# first of three rows: north, east and down components of the gust
_GUST = parameter_row("wind.gust_north")
_GUST_START = parameter_row("wind.gust_start")
_GUST_LENGTH = parameter_row("wind.gust_length")
# first row of the wind's north and east components and of both shears
_WIND = parameter_row("wind.north")
_SIGMA = parameter_row("wind.turbulence")
_LENGTH = parameter_row("wind.turbulence_length")
# first of three rows: forward, right and down axes
_AXIS_SIGMA = parameter_row("wind.turbulence_forward")
_AXIS_LENGTH = parameter_row("wind.turbulence_length_forward")
_ROTARY = parameter_row("wind.turbulence_rotary")
_SEED = parameter_row("wind.turbulence_seed")
_PROFILE = parameter_row(f"atmosphere.density_at_{DENSITY_KNOTS_KM[0]}km")
_KNOTS = len(DENSITY_KNOTS_KM)
_FIRST_KNOT = 1000.0 * DENSITY_KNOTS_KM[0]
_KNOT_STEP = 1000.0 * (DENSITY_KNOTS_KM[1] - DENSITY_KNOTS_KM[0])


@lanes
def any_lane(Z, width, first, rows, value):
    """Return whether any of ``rows`` rows, starting at ``first``, differs from ``value``."""
    different = 0
    for row in range(first, first + rows):
        for lane in range(width):
            different += Z[row, lane] != value
    return different > 0


@lanes
def seed_stream(Z, width, first_row, seed_row, stream):
    """Initialize random stream number ``stream`` from each flight's seed, in six rows."""
    for word in range(N_STREAM_ROWS):
        modulus = M1 if word < 3 else M2
        for lane in range(width):
            number = float(N_STREAM_ROWS * stream + word)
            Z[first_row + word, lane] = seed_word(Z[seed_row, lane], number, modulus)
    # The first numbers are discarded, because they are simple functions of the seed.
    for _ in range(8):
        for lane in range(width):
            draw(Z, lane, first_row)


@lanes
def draw(Z, lane, r):
    """Return the next uniform random number of a lane."""
    u, s0, s1, s2, s3, s4, s5 = next_uniform(
        Z[r, lane], Z[r + 1, lane], Z[r + 2, lane], Z[r + 3, lane], Z[r + 4, lane], Z[r + 5, lane]
    )
    Z[r, lane] = s0
    Z[r + 1, lane] = s1
    Z[r + 2, lane] = s2
    Z[r + 3, lane] = s3
    Z[r + 4, lane] = s4
    Z[r + 5, lane] = s5
    return u


@lanes
def draw_normals(Z, lane, r):
    """Return two standard normal random numbers of a lane."""
    u1 = draw(Z, lane, r)
    u2 = draw(Z, lane, r)
    return normal_pair(u1, u2)


class Disturbances(NamedTuple):
    """Disturbances that are active in any lane; inactive disturbances are not computed."""

    gusty: bool
    turbulent: bool
    profiled: bool  # whether there is a density profile
    windy: bool  # whether there is any wind, gust or turbulence


@lanes
def active_disturbances(Z, width):
    """Determine the active disturbances from the flights' parameters."""
    gusty = any_lane(Z, width, _GUST, 3, 0.0)
    turbulent = any_lane(Z, width, _SIGMA, 1, 0.0)
    windy = gusty or turbulent or any_lane(Z, width, _WIND, 4, 0.0)
    return Disturbances(gusty, turbulent, any_lane(Z, width, _PROFILE, _KNOTS, 1.0), windy)


@lanes
def calm(Z, width):
    """Reset gusts to zero, and density and temperature factors to one."""
    for lane in range(width):
        Z[s.GUST_P, lane] = 0.0
        Z[s.GUST_Q, lane] = 0.0
        Z[s.GUST_R, lane] = 0.0
        Z[s.GUST_U, lane] = 0.0
        Z[s.GUST_V, lane] = 0.0
        Z[s.GUST_W, lane] = 0.0
        Z[s.DENSITY_PROFILE, lane] = 1.0
        Z[s.TEMPERATURE_PROFILE, lane] = 1.0


@lanes
def disturb(Z, width, span, active, time, dt, first):
    """Add body-axis gusts and density factor for the tick that starts at ``time`` (s)."""
    if active.gusty:
        gust(Z, width, time)
    if active.turbulent:
        turbulence(Z, width, span, dt, first)
    if active.profiled:
        density_profile(Z, width)


@lanes
def gust(Z, width, time):
    """Add the discrete 1-cosine gust as a function of the distance covered."""
    for lane in range(width):
        distance = Z[s.SPEED, lane] * (time - Z[_GUST_START, lane])
        share = one_minus_cosine(distance, Z[_GUST_LENGTH, lane])
        q0, q1, q2, q3 = quaternion_at(Z, X + s.Q0, lane)
        north = share * Z[_GUST, lane]
        east = share * Z[_GUST + 1, lane]
        down = share * Z[_GUST + 2, lane]
        u, v, w = rotate_to_body(q0, q1, q2, q3, north, east, down)
        Z[s.GUST_U, lane] += u
        Z[s.GUST_V, lane] += v
        Z[s.GUST_W, lane] += w


@lanes
def turbulence(Z, width, span, dt, first):
    """Add Dryden turbulence along and about the body axes, stationary from the start.

    The rotation of the air follows from the gusts' derivatives along the path, q = -dw/dx and r =
    dv/dx, each with a lag that depends on the span.
    """
    if first:
        seed_stream(Z, width, TURBULENCE, _SEED, 0)
    for lane in range(width):
        speed = Z[s.SPEED, lane]
        length = Z[_LENGTH, lane]
        a = speed / (length * Z[_AXIS_LENGTH, lane])
        a_v = speed / (length * Z[_AXIS_LENGTH + 1, lane])
        a_w = speed / (length * Z[_AXIS_LENGTH + 2, lane])
        n0, n1 = draw_normals(Z, lane, TURBULENCE)
        n2, n3 = draw_normals(Z, lane, TURBULENCE)
        n4, n5 = draw_normals(Z, lane, TURBULENCE)
        u = n0 if first else dryden_first(Z[FILTERS, lane], a, dt, n0)
        v1, v2 = dryden_second(Z[FILTERS + 1, lane], Z[FILTERS + 2, lane], a_v, dt, n1, n2, first)
        w1, w2 = dryden_second(Z[FILTERS + 3, lane], Z[FILTERS + 4, lane], a_w, dt, n3, n4, first)
        Z[FILTERS, lane] = u
        Z[FILTERS + 1, lane] = v1
        Z[FILTERS + 2, lane] = v2
        Z[FILTERS + 3, lane] = w1
        Z[FILTERS + 4, lane] = w2
        sigma = Z[_SIGMA, lane]
        sigma_w = sigma * Z[_AXIS_SIGMA + 2, lane]
        across = sigma * Z[_AXIS_SIGMA + 1, lane] * dryden_second_output(v1, v2, a_v)
        down = sigma_w * dryden_second_output(w1, w2, a_w)
        Z[s.GUST_U, lane] += sigma * Z[_AXIS_SIGMA, lane] * u
        Z[s.GUST_V, lane] += across
        Z[s.GUST_W, lane] += down
        per_span = 0.25 * math.pi / span
        p = n5 if first else dryden_first(Z[FILTERS + 5, lane], speed * per_span, dt, n5)
        late_v = (
            across
            if first
            else follow(Z[FILTERS + 6, lane], across, 4.0 / 3.0 * speed * per_span, dt)
        )
        late_w = down if first else follow(Z[FILTERS + 7, lane], down, speed * per_span, dt)
        Z[FILTERS + 5, lane] = p
        Z[FILTERS + 6, lane] = late_v
        Z[FILTERS + 7, lane] = late_w
        rotary = Z[_ROTARY, lane]
        Z[s.GUST_P, lane] = (
            rotary * sigma_w * roll_gust_sigma(length * Z[_AXIS_LENGTH + 2, lane], span) * p
        )
        Z[s.GUST_Q, lane] = rotary * per_span * (late_w - down)
        Z[s.GUST_R, lane] = rotary * 4.0 / 3.0 * per_span * (across - late_v)


@lanes
def density_profile(Z, width):
    """Set the density factor, linear between the knots and constant beyond them."""
    for lane in range(width):
        x = (Z[X + s.ALTITUDE, lane] - _FIRST_KNOT) / _KNOT_STEP
        x = 0.0 if x < 0.0 else x
        x = _KNOTS - 1.0 if x > _KNOTS - 1.0 else x
        factor = 1.0
        for knot in range(_KNOTS):
            near = 1.0 - abs(x - knot)
            factor += (Z[_PROFILE + knot, lane] - 1.0) * (near if near > 0.0 else 0.0)
        Z[s.DENSITY_PROFILE, lane] = factor
