"""Attitude as a unit quaternion, scalar first, from body to NED components.

The rotation is v_N = q v_B q*. Yaw, pitch and roll are the 3-2-1 angles from NED to body. The
formulas are from Stevens, Lewis and Johnson, "Aircraft Control and Simulation", 3rd ed., sec. 1.8.
Each function computes the matrix elements itself; the compiler evaluates them only once if several
calls use the same quaternion.
"""

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import sincos


@scalar
def rotate_to_ned(
    q0: float, q1: float, q2: float, q3: float, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Return the NED components of a vector with body components x, y, z."""
    north = (
        (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * x
        + 2.0 * (q1 * q2 - q0 * q3) * y
        + 2.0 * (q1 * q3 + q0 * q2) * z
    )
    east = (
        2.0 * (q1 * q2 + q0 * q3) * x
        + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * y
        + 2.0 * (q2 * q3 - q0 * q1) * z
    )
    down = (
        2.0 * (q1 * q3 - q0 * q2) * x
        + 2.0 * (q2 * q3 + q0 * q1) * y
        + (1.0 - 2.0 * (q1 * q1 + q2 * q2)) * z
    )
    return north, east, down


@scalar
def rotate_to_body(
    q0: float, q1: float, q2: float, q3: float, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """Return the body components of a vector with the given NED components."""
    x = (
        (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * north
        + 2.0 * (q1 * q2 + q0 * q3) * east
        + 2.0 * (q1 * q3 - q0 * q2) * down
    )
    y = (
        2.0 * (q1 * q2 - q0 * q3) * north
        + (1.0 - 2.0 * (q1 * q1 + q3 * q3)) * east
        + 2.0 * (q2 * q3 + q0 * q1) * down
    )
    z = (
        2.0 * (q1 * q3 + q0 * q2) * north
        + 2.0 * (q2 * q3 - q0 * q1) * east
        + (1.0 - 2.0 * (q1 * q1 + q2 * q2)) * down
    )
    return x, y, z


@scalar
def rotate_meridional(
    q0: float, q1: float, q2: float, q3: float, north: float, down: float
) -> tuple[float, float, float]:
    """Return the body components of a vector without an east component."""
    x = (1.0 - 2.0 * (q2 * q2 + q3 * q3)) * north + 2.0 * (q1 * q3 - q0 * q2) * down
    y = 2.0 * (q1 * q2 - q0 * q3) * north + 2.0 * (q2 * q3 + q0 * q1) * down
    z = 2.0 * (q1 * q3 + q0 * q2) * north + (1.0 - 2.0 * (q1 * q1 + q2 * q2)) * down
    return x, y, z


@scalar
def quaternion_rate(
    q0: float, q1: float, q2: float, q3: float, p: float, q: float, r: float
) -> tuple[float, float, float, float]:
    """Return the derivative, 1/s, for body rates p, q, r (rad/s, body axes) relative to NED."""
    return (
        -0.5 * (q1 * p + q2 * q + q3 * r),
        0.5 * (q0 * p + q2 * r - q3 * q),
        0.5 * (q0 * q + q3 * p - q1 * r),
        0.5 * (q0 * r + q1 * q - q2 * p),
    )


@scalar
def from_euler(yaw: float, pitch: float, roll: float) -> tuple[float, float, float, float]:
    """Return the quaternion of 3-2-1 angles, rad."""
    s_yaw, c_yaw = sincos(0.5 * yaw)
    s_pitch, c_pitch = sincos(0.5 * pitch)
    s_roll, c_roll = sincos(0.5 * roll)
    return (
        c_yaw * c_pitch * c_roll + s_yaw * s_pitch * s_roll,
        c_yaw * c_pitch * s_roll - s_yaw * s_pitch * c_roll,
        c_yaw * s_pitch * c_roll + s_yaw * c_pitch * s_roll,
        s_yaw * c_pitch * c_roll - c_yaw * s_pitch * s_roll,
    )


@lanes
def quaternion_at(Z, row, lane):
    """Return the quaternion in four rows of the lane memory, starting at ``row``."""
    return Z[row, lane], Z[row + 1, lane], Z[row + 2, lane], Z[row + 3, lane]


@lanes
def vector_at(Z, row, lane):
    """Return the vector in three rows of the lane memory, starting at ``row``."""
    return Z[row, lane], Z[row + 1, lane], Z[row + 2, lane]
