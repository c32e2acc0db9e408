"""Control allocation, eq. (19) of Zhu & Shen (2014): nominal moment and its derivatives.

Moments are about the centre of gravity. Coefficients are about the moment reference, so the force
caused by a deflection adds a moment through its lever arm. The axes are those of the equations of
motion.
"""

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import sincos
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import N_INPUTS
from abhv_mc_vehicle.kernel.plant.foreign import thrust
from abhv_mc_vehicle.kernel.plant.runge_kutta import aerodynamic_force


@lanes
def force_of(Z, lane, constants, q_bar, row, stride):
    """Return the force in N that coefficients, or their slopes, produce at the flow angles.

    The coefficients are in the rows ``row``, ``row + stride``, ...
    """
    flow = sincos(Z[s.V_ALPHA, lane]) + sincos(Z[s.V_BETA, lane])
    lift = Z[row, lane]
    drag = Z[row + stride, lane]
    side = Z[row + 2 * stride, lane]
    return aerodynamic_force(constants, q_bar, lift, drag, side, flow)


@lanes
def moment_about_cg(Z, lane, constants, q_bar, row, stride, fx, fy, fz):
    """Return the moment about the centre of gravity due to coefficients and a force, N m.

    The force (N) acts at the moment reference.
    """
    q_s = q_bar * constants.area
    cg_x = Z[s.CG_X, lane]
    cg_z = Z[s.CG_Z, lane]
    return (
        q_s * constants.span * Z[row + 3 * stride, lane] + cg_z * fy,
        q_s * constants.chord * Z[row + 4 * stride, lane] + cg_x * fz - cg_z * fx,
        q_s * constants.span * Z[row + 5 * stride, lane] - cg_x * fy,
    )


@scalar
def side_force_slope(constants, q_s, side_by_sideslip, drag):
    """Return the derivative of the wind-axis side force with respect to sideslip, N/rad.

    The derivative is taken at zero sideslip. Drag in stability axes contributes to the derivative.
    """
    return q_s * side_by_sideslip + (0.0 if constants.drag_in_wind_axes > 0.0 else q_s * drag)


@lanes
def nominal_moment(Z, lane, constants, density, q_bar, speed):
    """Return the nominal vehicle's moment about its centre of gravity, N m.

    The moment is evaluated at the measured state and the last commands.
    """
    fx, fy, fz = force_of(Z, lane, constants, q_bar, s.COEF, 1)
    t = thrust(Z, lane, constants, Z[s.V_ETA, lane], density, speed, q_bar)
    tx = t * constants.thrust_cos
    tz = -t * constants.thrust_sin
    f_x, f_y, f_z = (
        Z[s.F_THRUST, lane],
        Z[s.F_THRUST + 1, lane],
        Z[s.F_THRUST + 2, lane],
    )  # force of an engine function
    m_x, m_y, m_z = moment_about_cg(
        Z, lane, constants, q_bar, s.COEF, 1, fx + tx + f_x, fy + f_y, fz + tz + f_z
    )
    return (
        m_x + Z[s.F_MOMENT, lane],
        m_y + constants.thrust_offset_z * tx + Z[s.F_MOMENT + 1, lane],
        m_z + Z[s.F_MOMENT + 2, lane],
    )


@lanes
def moment_slope(Z, lane, constants, q_bar, first_slope, deflection):
    """Return the derivative of :func:`nominal_moment` with respect to a deflection, N m/rad.

    Deflection 0 is the aileron, 1 the rudder and 2 the elevator. ``first_slope`` is the first row
    of :func:`abhv_mc_vehicle.kernel.plant.aerodynamics.slopes_of_coefficients`.
    """
    row = first_slope + deflection
    fx, fy, fz = force_of(Z, lane, constants, q_bar, row, N_INPUTS)
    return moment_about_cg(Z, lane, constants, q_bar, row, N_INPUTS, fx, fy, fz)


@scalar
def solve_3x3(a, b, c, d, e, f, g, h, i, x, y, z):
    """Solve [[a, b, c], [d, e, f], [g, h, i]] u = (x, y, z); u is 0 if the matrix is singular."""
    c_0 = e * i - f * h
    c_1 = f * g - d * i
    c_2 = d * h - e * g
    determinant = a * c_0 + b * c_1 + c * c_2
    inverse = 1.0 / (determinant if determinant != 0.0 else 1.0)
    inverse = inverse if determinant != 0.0 else 0.0
    return (
        inverse * (c_0 * x + (c * h - b * i) * y + (b * f - c * e) * z),
        inverse * (c_1 * x + (a * i - c * g) * y + (c * d - a * f) * z),
        inverse * (c_2 * x + (b * g - a * h) * y + (a * e - b * d) * z),
    )
