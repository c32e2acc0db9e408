"""Rigid-body dynamics: angular acceleration, and forces added to derivatives."""

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import reciprocals
from abhv_mc_vehicle.kernel.plant import state as s


@scalar
def angular_acceleration(ixx, iyy, izz, i13, p, q, r, mx, my, mz):
    """Return J^-1 (M - w x J w), eq. (3); ``i13`` is element 13 of the inertia matrix J."""
    hx = ixx * p + i13 * r
    hy = iyy * q
    hz = izz * r + i13 * p
    tx = mx - (q * hz - r * hy)
    ty = my - (r * hx - p * hz)
    tz = mz - (p * hy - q * hx)
    inverse, per_iyy = reciprocals(ixx * izz - i13 * i13, iyy)
    return (izz * tx - i13 * tz) * inverse, ty * per_iyy, (ixx * tz - i13 * tx) * inverse


@lanes
def add_derivative(Z, lane, i, derivative, stage):
    """Add a term to a derivative after ``equations.accumulate``."""
    Z[s.SUM + i, lane] += stage.weight * derivative
    Z[s.XS + i, lane] += stage.ahead * derivative


@lanes
def add_force(Z, lane, stage, per_mass, fx, fy, fz):
    """Add a force at the centre of gravity to the derivatives and the specific force.

    The force is given in N and body axes.
    """
    x = fx * per_mass
    y = fy * per_mass
    z = fz * per_mass
    Z[s.SPECIFIC_X, lane] += x
    Z[s.SPECIFIC_Y, lane] += y
    Z[s.SPECIFIC_Z, lane] += z
    add_derivative(Z, lane, s.U, x, stage)
    add_derivative(Z, lane, s.V, y, stage)
    add_derivative(Z, lane, s.W, z, stage)


@lanes
def add_moment(Z, lane, stage, mx, my, mz):
    """Add a moment (N m, body axes) to the derivatives; return its angular acceleration."""
    p_dot, q_dot, r_dot = angular_acceleration(
        Z[s.INERTIA_XX, lane] * Z[s.K_XX, lane],
        Z[s.INERTIA_YY, lane] * Z[s.K_YY, lane],
        Z[s.INERTIA_ZZ, lane] * Z[s.K_ZZ, lane],
        Z[s.INERTIA_13, lane] * Z[s.K_13, lane],
        0.0,
        0.0,
        0.0,
        mx,
        my,
        mz,
    )
    add_derivative(Z, lane, s.ROLL_RATE, p_dot, stage)
    add_derivative(Z, lane, s.PITCH_RATE, q_dot, stage)
    add_derivative(Z, lane, s.YAW_RATE, r_dot, stage)
    return p_dot, q_dot, r_dot
