"""Initial state of each flight: the nominal state with the flight's initial errors."""

import math

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import atan2, sincos
from abhv_mc_vehicle.kernel.numerics.quaternion import quaternion_at, rotate_to_body, rotate_to_ned
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.state import XS, X, parameter_rows

_ALTITUDE, _SPEED, _PATH, _HEADING, _ALPHA, _BETA, _BANK, _ROLL_RATE, _PITCH_RATE, _YAW_RATE = (
    parameter_rows("initial.altitude", 10)
)


@scalar
def multiply(a0, a1, a2, a3, b0, b1, b2, b3):
    """Return the quaternion product a b, scalar first."""
    return (
        a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
        a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
        a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
        a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
    )


@lanes
def start_flights(Z, width, initial_state):
    """Set the initial state of every lane from the nominal state and initial errors.

    An error in speed does not change the flow angles. Errors in heading and flight path rotate
    velocity and body together; errors in bank rotate the body about the velocity; errors in angle
    of attack and sideslip rotate the body relative to the velocity. Without errors the state is
    unchanged.
    """
    for lane in range(width):
        for i in range(s.N_STATES):
            Z[X + i, lane] = initial_state[i]
        u = initial_state[s.U]
        v = initial_state[s.V]
        w = initial_state[s.W]
        q0 = initial_state[s.Q0]
        q1 = initial_state[s.Q1]
        q2 = initial_state[s.Q2]
        q3 = initial_state[s.Q3]
        v_n, v_e, v_d = rotate_to_ned(q0, q1, q2, q3, u, v, w)
        speed = math.sqrt(u * u + v * v + w * w)
        level = math.sqrt(v_n * v_n + v_e * v_e)
        moving = level > 0.0

        sine, cosine = sincos(0.5 * Z[_BANK, lane])
        inverse = sine / (speed if speed > 0.0 else 1.0)
        q0, q1, q2, q3 = multiply(
            cosine, inverse * v_n, inverse * v_e, inverse * v_d, q0, q1, q2, q3
        )
        sine, cosine = sincos(0.5 * Z[_PATH, lane])
        inverse = sine / (level if moving else 1.0)
        q0, q1, q2, q3 = multiply(cosine, -inverse * v_e, inverse * v_n, 0.0, q0, q1, q2, q3)
        sine, cosine = sincos(0.5 * Z[_HEADING, lane])
        q0, q1, q2, q3 = multiply(cosine, 0.0, 0.0, sine, q0, q1, q2, q3)

        sine, cosine = sincos(0.5 * Z[_ALPHA, lane])
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, cosine, 0.0, sine, 0.0)
        sine, cosine = sincos(Z[_ALPHA, lane])
        u, w = cosine * u - sine * w, cosine * w + sine * u
        sine, cosine = sincos(-0.5 * Z[_BETA, lane])
        q0, q1, q2, q3 = multiply(q0, q1, q2, q3, cosine, 0.0, 0.0, sine)
        sine, cosine = sincos(Z[_BETA, lane])
        u, v = cosine * u - sine * v, cosine * v + sine * u

        ratio = (speed + Z[_SPEED, lane]) / (speed if speed > 0.0 else 1.0)
        ratio = ratio if speed > 0.0 else 1.0
        Z[X + s.U, lane] = ratio * u
        Z[X + s.V, lane] = ratio * v
        Z[X + s.W, lane] = ratio * w
        Z[X + s.Q0, lane] = q0
        Z[X + s.Q1, lane] = q1
        Z[X + s.Q2, lane] = q2
        Z[X + s.Q3, lane] = q3
        Z[X + s.ALTITUDE, lane] += Z[_ALTITUDE, lane]
        Z[X + s.ROLL_RATE, lane] += Z[_ROLL_RATE, lane]
        Z[X + s.PITCH_RATE, lane] += Z[_PITCH_RATE, lane]
        Z[X + s.YAW_RATE, lane] += Z[_YAW_RATE, lane]
        Z[X + s.MASS, lane] *= Z[s.K_MASS, lane]
        Z[s.PER_MASS_FACTOR, lane] = 1.0 / Z[s.K_MASS, lane]
        for i in range(s.N_STATES):
            Z[XS + i, lane] = Z[X + i, lane]
        Z[s.CMD_AILERON, lane] = initial_state[s.AILERON]
        Z[s.CMD_RUDDER, lane] = initial_state[s.RUDDER]
        Z[s.CMD_ELEVATOR, lane] = initial_state[s.ELEVATOR]
        Z[s.CMD_ETA, lane] = initial_state[s.ETA]


@lanes
def face_air(Z, width):
    """Rotate each vehicle about the vertical into the relative wind, to make sideslip zero.

    The function initializes vehicles whose instruments measure the sideslip relative to the air.
    The velocity of the air is read from the lane memory.
    """
    for lane in range(width):
        q0, q1, q2, q3 = quaternion_at(Z, X + s.Q0, lane)
        v_n, v_e, v_d = rotate_to_ned(
            q0, q1, q2, q3, Z[X + s.U, lane], Z[X + s.V, lane], Z[X + s.W, lane]
        )
        w_n, w_e, _ = rotate_to_ned(
            q0, q1, q2, q3, Z[s.AIR_U, lane], Z[s.AIR_V, lane], Z[s.AIR_W, lane]
        )
        a_n = v_n - w_n
        a_e = v_e - w_e
        sine, cosine = sincos(0.5 * atan2(v_n * a_e - v_e * a_n, v_n * a_n + v_e * a_e))
        q0, q1, q2, q3 = multiply(cosine, 0.0, 0.0, sine, q0, q1, q2, q3)
        u, v, w = rotate_to_body(q0, q1, q2, q3, v_n, v_e, v_d)
        Z[X + s.U, lane] = u
        Z[X + s.V, lane] = v
        Z[X + s.W, lane] = w
        Z[X + s.Q0, lane] = q0
        Z[X + s.Q1, lane] = q1
        Z[X + s.Q2, lane] = q2
        Z[X + s.Q3, lane] = q3
        for i in range(s.U, s.Q3 + 1):
            Z[XS + i, lane] = Z[X + i, lane]
