"""Motion relative to the Earth, and measurements relative to the air, at a control tick."""

import math

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.numerics.lane_math import asin, atan2, sincos, two_angles
from abhv_mc_vehicle.kernel.numerics.quaternion import (
    quaternion_at,
    rotate_to_body,
    rotate_to_ned,
    vector_at,
)
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.air_data import flow_direction, warm_air
from abhv_mc_vehicle.kernel.plant.state import X
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere_lanes

_G0 = 9.80665  # standard gravity, m/s2
SEA_LEVEL_DENSITY = 1.225  # sea-level density for the equivalent airspeed, kg/m3


@scalar
def bank_angle(q0, q1, q2, q3, sin_alpha, cos_alpha, sin_beta, cos_beta):
    """Return the bank angle about the velocity, from the vertical's direction in wind axes."""
    d_x, d_y, d_z = rotate_to_body(
        q0, q1, q2, q3, 0.0, 0.0, 1.0
    )  # NED down axis in body components
    y_down = -cos_alpha * sin_beta * d_x + cos_beta * d_y - sin_alpha * sin_beta * d_z
    z_down = -sin_alpha * d_x + cos_alpha * d_z
    return atan2(y_down, z_down)


@lanes
def navigate(Z, width, tick, first):
    """Compute the true motion, copy it to the measured rows, and integrate the ground track."""
    for lane in range(width):
        u, v, w = vector_at(Z, X + s.U, lane)
        q0, q1, q2, q3 = quaternion_at(Z, X + s.Q0, lane)
        v_n, v_e, v_d = rotate_to_ned(q0, q1, q2, q3, u, v, w)
        speed, _, sin_a, cos_a, sin_b, cos_b = flow_direction(u, v, w)
        alpha, beta = two_angles(sin_a, cos_a, sin_b, cos_b)
        gamma = atan2(-v_d, math.sqrt(v_n * v_n + v_e * v_e))
        chi = atan2(v_e, v_n)
        bank = bank_angle(q0, q1, q2, q3, sin_a, cos_a, sin_b, cos_b)
        half = 0.0 if first else 0.5 * tick
        Z[s.NORTH, lane] += half * (v_n + Z[s.V_NORTH_LAST, lane])
        Z[s.EAST, lane] += half * (v_e + Z[s.V_EAST_LAST, lane])
        Z[s.V_NORTH_LAST, lane] = v_n
        Z[s.V_EAST_LAST, lane] = v_e
        Z[s.SPEED, lane] = speed
        Z[s.GAMMA, lane] = gamma
        Z[s.CHI, lane] = chi
        Z[s.BANK, lane] = bank
        Z[s.M_ALTITUDE, lane] = Z[X + s.ALTITUDE, lane]
        Z[s.M_SPEED, lane] = speed
        Z[s.M_GAMMA, lane] = gamma
        Z[s.M_CHI, lane] = chi
        Z[s.M_ALPHA, lane] = alpha
        Z[s.M_BETA, lane] = beta
        Z[s.M_BANK, lane] = bank
        Z[s.M_P, lane] = Z[X + s.ROLL_RATE, lane]
        Z[s.M_Q, lane] = Z[X + s.PITCH_RATE, lane]
        Z[s.M_R, lane] = Z[X + s.YAW_RATE, lane]


@lanes
def measure_air(Z, width, sensing):
    """Compute measurements relative to the air, whose velocity is in the lane memory."""
    for lane in range(width):
        speed, _, sin_a, cos_a, sin_b, cos_b = flow_direction(
            Z[X + s.U, lane] - Z[s.AIR_U, lane],
            Z[X + s.V, lane] - Z[s.AIR_V, lane],
            Z[X + s.W, lane] - Z[s.AIR_W, lane],
        )
        alpha, beta = two_angles(sin_a, cos_a, sin_b, cos_b)
        Z[s.M_SPEED, lane] = speed if sensing.speed > 0 else Z[s.M_SPEED, lane]
        Z[s.M_ALPHA, lane] = alpha if sensing.angle_of_attack > 0 else Z[s.M_ALPHA, lane]
        Z[s.M_BETA, lane] = beta if sensing.sideslip > 0 else Z[s.M_BETA, lane]


@lanes
def measure_more(Z, width, reference, tick, warm):
    """Compute the additional measurements for custom control laws.

    The load factor is taken from the previous step, and is 1 at the start. For control laws that
    read the specific force, the forces have been evaluated at the tick, so it is up to date.
    """
    sin_h, cos_h = sincos(reference[tick, ref.HEADING])
    atmosphere_lanes(
        Z, width, X + s.ALTITUDE, s.M_AIRSPEED, s.M_MACH
    )  # density, and 1 / speed of sound
    if warm:
        warm_air(Z, width, s.M_AIRSPEED, s.M_MACH)
    for lane in range(width):
        u, v, w = vector_at(Z, X + s.U, lane)
        airspeed, _, _, _, _, _ = flow_direction(
            u - Z[s.AIR_U, lane], v - Z[s.AIR_V, lane], w - Z[s.AIR_W, lane]
        )
        density = Z[s.M_AIRSPEED, lane] * (Z[s.K_DENSITY, lane] * Z[s.DENSITY_PROFILE, lane])
        Z[s.M_EQUIVALENT_AIRSPEED, lane] = airspeed * math.sqrt(density / SEA_LEVEL_DENSITY)
        north = Z[s.NORTH, lane] - reference[tick, ref.NORTH]
        east = Z[s.EAST, lane] - reference[tick, ref.EAST]
        Z[s.M_CROSS_TRACK, lane] = north * sin_h - east * cos_h
        Z[s.M_AIRSPEED, lane] = airspeed
        Z[s.M_MACH, lane] = airspeed * Z[s.M_MACH, lane]
        x, y, z = vector_at(Z, s.SPECIFIC_X, lane)
        Z[s.M_LOAD_FACTOR, lane] = 1.0 if tick == 0 else math.sqrt(x * x + y * y + z * z) / _G0
        q0, q1, q2, q3 = quaternion_at(Z, X + s.Q0, lane)
        Z[s.M_PITCH, lane] = asin(2.0 * (q0 * q2 - q1 * q3))
        Z[s.M_ROLL, lane] = atan2(2.0 * (q0 * q1 + q2 * q3), q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3)
        Z[s.M_YAW, lane] = atan2(2.0 * (q0 * q3 + q1 * q2), q0 * q0 + q1 * q1 - q2 * q2 - q3 * q3)
        Z[s.M_LATITUDE, lane] = Z[X + s.LATITUDE, lane]
        Z[s.M_LONGITUDE, lane] = Z[X + s.LONGITUDE, lane]
        Z[s.M_NORTH, lane] = Z[s.NORTH, lane]
        Z[s.M_EAST, lane] = Z[s.EAST, lane]
        for i in range(3):
            Z[s.M_ACCELERATION + i, lane] = Z[s.SPECIFIC_X + i, lane]
