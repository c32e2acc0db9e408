"""Last loop of a Runge-Kutta stage: forces, state derivatives and their sums.

Body axes are forward-right-down, the local frame is north-east-down, and the Earth is a rotating
ellipsoid. The equations are (2)-(4) of Zhu & Shen (2014) in these axes; moments are about the
centre of gravity.
"""

import math
from typing import NamedTuple

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.numerics.lane_math import reciprocals
from abhv_mc_vehicle.kernel.numerics.quaternion import (
    quaternion_at,
    quaternion_rate,
    rotate_meridional,
    rotate_to_body,
    rotate_to_ned,
    vector_at,
)
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.foreign import thrust
from abhv_mc_vehicle.kernel.plant.rigid_body import angular_acceleration
from abhv_mc_vehicle.kernel.plant.state import SUM, XS, X, parameter_rows
from abhv_mc_vehicle.kernel.world.earth import gravity_ned, radii

_LIFT, _DRAG, _SIDE_FORCE, _ROLL, _PITCH, _YAW = range(s.COEF, s.COEF + 6)

_K_LIFT, _K_DRAG, _K_SIDE_FORCE, _K_ROLL, _K_PITCH, _K_YAW, _D_LIFT, _D_DRAG, _D_PITCH = (
    parameter_rows("aero.lift", 9)
)


@scalar
def aerodynamic_force(constants, q_bar, lift, drag, side, flow):
    """Return the aerodynamic force, N, body axes, from stability- or wind-axis coefficients.

    ``flow`` contains sine and cosine of the angle of attack, followed by those of the sideslip.
    """
    sin_a, cos_a, sin_b, cos_b = flow
    q_s = q_bar * constants.area
    in_wind = constants.drag_in_wind_axes > 0.0
    drag_plane = drag * cos_b if in_wind else drag
    side_total = side - drag * sin_b if in_wind else side
    return (
        q_s * (lift * sin_a - drag_plane * cos_a),
        q_s * side_total,
        q_s * (-lift * cos_a - drag_plane * sin_a),
    )


class Stage(NamedTuple):
    """Stage with derivative ``k``: adds ``weight k`` to the sum; next state ``x + ahead k``."""

    weight: float
    ahead: float  # time from the start of the step to the next stage, s


@scalar
def runge_kutta_stage(stage, step):
    """Return stage 0..3 of the classical Runge-Kutta method, see :func:`finish_step`.

    Stage -1 does not change sum or state; it evaluates the forces at a control tick, for
    measurement.
    """
    moves = 0.0 if stage < 0 else 1.0
    return Stage(
        moves * (2.0 if abs(stage - 1.5) < 1.0 else 1.0),  # The middle stages have weight 2.
        moves * (step if stage == 2 else 0.5 * step),
    )


@lanes
def accumulate(Z, lane, i, derivative, stage):
    """Add a derivative to the Runge-Kutta sum, and set the next stage's state."""
    Z[SUM + i, lane] += stage.weight * derivative
    Z[XS + i, lane] = Z[X + i, lane] + stage.ahead * derivative


@lanes
def equations_of_motion(Z, width, vehicle, earth, stage, active):
    """Compute the derivatives at the stage's state ``XS``, and the next stage's state.

    Actuators are computed separately. If ``active`` is not None, a thrust function may cause a
    moment, and the thrust may be offset from the thrust line.
    """
    constants = vehicle.constants
    for lane in range(width):
        altitude = Z[XS + s.ALTITUDE, lane]
        u, v, w = vector_at(Z, XS + s.U, lane)
        q0, q1, q2, q3 = quaternion_at(Z, XS + s.Q0, lane)
        p, q, r = vector_at(Z, XS + s.ROLL_RATE, lane)
        mass = Z[XS + s.MASS, lane]
        q_bar = Z[s.Q_BAR, lane]

        # Forces, and moments about the centre of gravity.
        lift = Z[_K_LIFT, lane] * Z[_LIFT, lane] + Z[_D_LIFT, lane]
        drag = Z[_K_DRAG, lane] * Z[_DRAG, lane] + Z[_D_DRAG, lane] + Z[s.ENGINE_DRAG, lane]
        side = Z[_K_SIDE_FORCE, lane] * Z[_SIDE_FORCE, lane]
        flow = Z[s.SIN_ALPHA, lane], Z[s.COS_ALPHA, lane], Z[s.SIN_BETA, lane], Z[s.COS_BETA, lane]
        fx, fy, fz = aerodynamic_force(constants, q_bar, lift, drag, side, flow)
        isp = Z[s.ISP, lane]
        # Without an empty mass, the vehicle has a constant mass and its engine always runs.
        fuel_left = mass > constants.mass_empty * Z[s.K_MASS, lane] or constants.burns_fuel == 0.0
        nominal_thrust = thrust(
            Z, lane, constants, Z[XS + s.ETA, lane], Z[s.RHO, lane], Z[s.AIRSPEED, lane], q_bar
        )
        nominal_thrust = nominal_thrust * Z[s.ENGINE_THRUST, lane] if fuel_left else 0.0
        t = Z[s.K_THRUST, lane] * nominal_thrust
        Z[s.THRUST, lane] = t
        fuel_divisor = constants.standard_gravity * isp * Z[s.K_ISP, lane]
        per_mass, per_fuel = reciprocals(mass, fuel_divisor if fuel_divisor > 0.0 else 1.0)
        # The thrust factor changes the thrust but not the fuel flow.
        fuel_flow = (
            nominal_thrust * per_fuel if fuel_divisor > 0.0 and constants.burns_fuel > 0.0 else 0.0
        )
        tx = t * constants.thrust_cos
        tz = -t * constants.thrust_sin
        cg_x = Z[s.CG_X, lane] + Z[s.K_CG_X, lane]
        cg_y = Z[s.K_CG_Y, lane]
        cg_z = Z[s.CG_Z, lane] + Z[s.K_CG_Z, lane]
        arm = constants.thrust_offset_z - cg_z
        q_s = q_bar * constants.area
        mx = q_s * constants.span * Z[_K_ROLL, lane] * Z[_ROLL, lane] - cg_y * (fz + tz) + cg_z * fy
        my = (
            q_s
            * constants.chord
            * (Z[_K_PITCH, lane] * Z[_PITCH, lane] + Z[_D_PITCH, lane] + Z[s.ENGINE_PITCH, lane])
            + cg_x * (fz + tz)
            - cg_z * fx
            + arm * tx
        )
        mz = q_s * constants.span * Z[_K_YAW, lane] * Z[_YAW, lane] - cg_x * fy + cg_y * (fx + tx)
        if active is not None:
            arm_x, arm_y, arm_z = vector_at(Z, s.ENGINE_ARM, lane)
            mx += Z[s.F_MOMENT, lane] + arm_y * tz
            my += Z[s.F_MOMENT + 1, lane] + (arm_z * tx - arm_x * tz)
            mz += Z[s.F_MOMENT + 2, lane] - arm_y * tx

        # Equations of rotation.
        ixx = Z[s.INERTIA_XX, lane] * Z[s.K_XX, lane]
        iyy = Z[s.INERTIA_YY, lane] * Z[s.K_YY, lane]
        izz = Z[s.INERTIA_ZZ, lane] * Z[s.K_ZZ, lane]
        i13 = Z[s.INERTIA_13, lane] * Z[s.K_13, lane]
        p_dot, q_dot, r_dot = angular_acceleration(ixx, iyy, izz, i13, p, q, r, mx, my, mz)
        accumulate(Z, lane, s.ROLL_RATE, p_dot, stage)
        accumulate(Z, lane, s.PITCH_RATE, q_dot, stage)
        accumulate(Z, lane, s.YAW_RATE, r_dot, stage)
        if active is not None:
            Z[s.ANGULAR_ACCELERATION, lane] = p_dot
            Z[s.ANGULAR_ACCELERATION + 1, lane] = q_dot
            Z[s.ANGULAR_ACCELERATION + 2, lane] = r_dot

        # Equations of translation over the ellipsoid.
        sin_lat = Z[s.SIN_LAT, lane]
        cos_lat = Z[s.COS_LAT, lane]
        meridian, vertical = radii(earth, sin_lat)
        v_n, v_e, v_d = rotate_to_ned(q0, q1, q2, q3, u, v, w)
        g_n, g_d = gravity_ned(earth, altitude, sin_lat, cos_lat)
        g_x, g_y, g_z = rotate_meridional(q0, q1, q2, q3, g_n, g_d)
        if active is not None:
            Z[s.GRAVITY, lane] = g_x
            Z[s.GRAVITY + 1, lane] = g_y
            Z[s.GRAVITY + 2, lane] = g_z
        we_x = Z[s.EARTH_X, lane]
        we_y = Z[s.EARTH_Y, lane]
        we_z = Z[s.EARTH_Z, lane]
        # Adding the Earth rate to the inertial body rate covers transport and Coriolis terms.
        a = p + we_x
        b = q + we_y
        c = r + we_z
        specific_x = (fx + tx) * per_mass
        specific_y = fy * per_mass
        specific_z = (fz + tz) * per_mass
        Z[s.SPECIFIC_X, lane] = specific_x
        Z[s.SPECIFIC_Y, lane] = specific_y
        Z[s.SPECIFIC_Z, lane] = specific_z
        accumulate(Z, lane, s.U, specific_x + g_x - (b * w - c * v), stage)
        accumulate(Z, lane, s.V, specific_y + g_y - (c * u - a * w), stage)
        accumulate(Z, lane, s.W, specific_z + g_z - (a * v - b * u), stage)
        per_north, per_east = reciprocals(meridian + altitude, (vertical + altitude) * cos_lat)
        lat_rate = v_n * per_north
        lon_rate = v_e * per_east
        accumulate(Z, lane, s.ALTITUDE, -v_d, stage)
        accumulate(Z, lane, s.LATITUDE, lat_rate, stage)
        accumulate(Z, lane, s.LONGITUDE, lon_rate, stage)

        # The attitude changes with the body rate relative to the local frame, which also rotates.
        n_x, n_y, n_z = rotate_to_body(
            q0, q1, q2, q3, lon_rate * cos_lat, -lat_rate, -lon_rate * sin_lat
        )
        d0, d1, d2, d3 = quaternion_rate(
            q0, q1, q2, q3, p - we_x - n_x, q - we_y - n_y, r - we_z - n_z
        )
        accumulate(Z, lane, s.Q0, d0, stage)
        accumulate(Z, lane, s.Q1, d1, stage)
        accumulate(Z, lane, s.Q2, d2, stage)
        accumulate(Z, lane, s.Q3, d3, stage)
        accumulate(Z, lane, s.MASS, -fuel_flow, stage)


@lanes
def finish_step(Z, width, step, alive):
    """Compute the new state from the sum of the stages, and normalize the quaternion.

    Ended flights (``alive`` 0) keep their state.
    """
    sixth = step / 6.0
    for i in range(s.AILERON):  # The actuator states, which come last, are already updated.
        for lane in range(width):
            Z[XS + i, lane] = Z[X + i, lane] + sixth * Z[SUM + i, lane]
            Z[SUM + i, lane] = 0.0
    for lane in range(width):
        q0, q1, q2, q3 = quaternion_at(Z, XS + s.Q0, lane)
        norm = 1.0 / math.sqrt(q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3)
        Z[XS + s.Q0, lane] = q0 * norm
        Z[XS + s.Q1, lane] = q1 * norm
        Z[XS + s.Q2, lane] = q2 * norm
        Z[XS + s.Q3, lane] = q3 * norm
        longitude = Z[XS + s.LONGITUDE, lane]
        turn = (
            -2.0 * math.pi
            if longitude > math.pi
            else (2.0 * math.pi if longitude < -math.pi else 0.0)
        )
        Z[XS + s.LONGITUDE, lane] = longitude + turn
    for i in range(s.N_STATES):
        for lane in range(width):
            before = Z[X + i, lane]
            after = Z[XS + i, lane]
            value = after if alive[lane] > 0.0 else before
            Z[X + i, lane] = value
            Z[XS + i, lane] = value
