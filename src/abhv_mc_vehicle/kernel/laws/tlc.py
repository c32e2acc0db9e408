"""Trajectory linearization control (TLC), for one control tick in all lanes.

The control law is from Zhu & Shen (2014), sections 4-6, in forward-right-down axes. Sub-loops 1 and
2 are linearized about the reference, so their gains are computed before the flight. Sub-loops 3 and
4 are linearized at each tick about the current commands. The control law uses only the nominal
vehicle and the measurement.
"""

from abhv_mc_vehicle.kernel.jit import lanes, scalar
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.allocation import (
    moment_slope,
    nominal_moment,
    side_force_slope,
    solve_3x3,
)
from abhv_mc_vehicle.kernel.laws.columns import TLC_ATTITUDE, TLC_K1, TLC_K2, TLC_RATE
from abhv_mc_vehicle.kernel.laws.tlc_loops import (
    AttitudePoint,
    Inertia,
    Spectrum,
    attitude_gains,
    attitude_inverse,
    differentiator_next,
    differentiator_output,
    moment_inverse,
    rate_gains,
)
from abhv_mc_vehicle.kernel.laws.trim_lookup import look_up_trim
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, exp, sincos, wrap
from abhv_mc_vehicle.kernel.plant import state as s
from abhv_mc_vehicle.kernel.plant.aerodynamics import (
    N_INPUTS,
    build_up,
    look_up,
    slopes_of_coefficients,
    table_slopes,
)
from abhv_mc_vehicle.kernel.plant.effectors import set_effectors
from abhv_mc_vehicle.kernel.plant.foreign import (
    nominal_coefficients,
    nominal_slopes,
    nominal_thrust,
)
from abhv_mc_vehicle.kernel.plant.state import LAW, N_COEFFICIENTS
from abhv_mc_vehicle.kernel.world.atmosphere import atmosphere_lanes

# Memory of the control law: error integrals, differentiator states, trim data and slopes.
I_ALTITUDE = LAW
I_GUIDANCE = LAW + 1  # integrals of path, heading and speed errors
I_ATTITUDE = LAW + 4  # integrals of angle of attack, sideslip and bank errors
I_RATE = LAW + 7  # integrals of roll, pitch and yaw rate errors
D_ALPHA, D_BANK, D_P, D_Q, D_R = range(LAW + 10, LAW + 15)
T_LIFT, T_DRAG, T_THRUST, T_LIFT_SLOPE, T_THRUST_SLOPE = range(LAW + 15, LAW + 20)
RHO_NOM = LAW + 20
SLOPES = LAW + 21
N_ROWS = 21 + N_COEFFICIENTS * N_INPUTS


@scalar
def six_from(gains, i):
    """Return six gains of the tick, starting at column ``i``."""
    return gains[i], gains[i + 1], gains[i + 2], gains[i + 3], gains[i + 4], gains[i + 5]


@scalar
def dot6(gains, errors):
    """Return the sum of products of six gains and six errors."""
    k0, k1, k2, k3, k4, k5 = gains
    e0, e1, e2, e3, e4, e5 = errors
    return k0 * e0 + k1 * e1 + k2 * e2 + k3 * e3 + k4 * e4 + k5 * e5


@lanes
def tlc_guidance(Z, width, vehicle, reference, gains, settings, k, dt):
    """Compute sub-loops 1 and 2: commands for path, angle of attack, bank and throttle."""
    constants = vehicle.constants
    g = gains[k]
    for lane in range(width):
        altitude = Z[s.M_ALTITUDE, lane] - reference[k, ref.ALTITUDE]
        int_altitude = Z[I_ALTITUDE, lane] + dt * altitude
        path_cmd = (
            reference[k, ref.FLIGHT_PATH_ANGLE]
            - g[TLC_K1] * int_altitude
            - g[TLC_K1 + 1] * altitude
        )
        path = Z[s.M_GAMMA, lane] - path_cmd
        heading = wrap(Z[s.M_CHI, lane] - reference[k, ref.HEADING])
        speed = Z[s.M_SPEED, lane] - reference[k, ref.SPEED]
        int_path = Z[I_GUIDANCE, lane] + dt * path
        int_heading = Z[I_GUIDANCE + 1, lane] + dt * heading
        int_speed = Z[I_GUIDANCE + 2, lane] + dt * speed
        errors = int_path, path, int_heading, heading, int_speed, speed
        alpha = reference[k, ref.ANGLE_OF_ATTACK] - dot6(six_from(g, TLC_K2), errors)
        bank = reference[k, ref.BANK] - dot6(six_from(g, TLC_K2 + 6), errors)
        eta = reference[k, ref.EQUIVALENCE_RATIO] - dot6(six_from(g, TLC_K2 + 12), errors)
        alpha_cmd = clamp(alpha, settings[2], settings[3])
        bank_cmd = clamp(bank, -settings[4], settings[4])
        eta_cmd = clamp(eta, constants.equivalence_ratio_min, constants.equivalence_ratio_max)
        # Anti-windup freezes the integrators of a limited command.
        vertical_free = alpha_cmd == alpha
        Z[I_ALTITUDE, lane] = int_altitude if vertical_free else Z[I_ALTITUDE, lane]
        Z[I_GUIDANCE, lane] = int_path if vertical_free else Z[I_GUIDANCE, lane]
        Z[I_GUIDANCE + 1, lane] = int_heading if bank_cmd == bank else Z[I_GUIDANCE + 1, lane]
        Z[I_GUIDANCE + 2, lane] = int_speed if eta_cmd == eta else Z[I_GUIDANCE + 2, lane]
        Z[s.GAMMA_CMD, lane] = path_cmd
        Z[s.ALPHA_CMD, lane] = alpha_cmd
        Z[s.BANK_CMD, lane] = bank_cmd
        Z[s.CMD_ETA, lane] = eta_cmd


@lanes
def nominal_variables(Z, width, vehicle, reference, k):
    """Set the nominal vehicle's variables to the measured state and the last commands."""
    constants = vehicle.constants
    atmosphere_lanes(Z, width, s.M_ALTITUDE, RHO_NOM, s.V_MACH)
    for lane in range(width):
        speed = Z[s.M_SPEED, lane]
        half_inverse = 0.5 / speed
        Z[s.V_ONE, lane] = 1.0
        Z[s.V_MACH, lane] = speed * Z[s.V_MACH, lane]
        Z[s.V_ALPHA, lane] = Z[s.M_ALPHA, lane]
        Z[s.V_BETA, lane] = Z[s.M_BETA, lane]
        Z[s.V_P_HAT, lane] = Z[s.M_P, lane] * constants.span * half_inverse
        Z[s.V_Q_HAT, lane] = Z[s.M_Q, lane] * constants.chord * half_inverse
        Z[s.V_R_HAT, lane] = Z[s.M_R, lane] * constants.span * half_inverse
        Z[s.V_DELTA_A, lane] = Z[s.CMD_AILERON, lane]
        Z[s.V_DELTA_R, lane] = Z[s.CMD_RUDDER, lane]
        Z[s.V_DELTA_E, lane] = Z[s.CMD_ELEVATOR, lane]
        Z[s.V_ETA, lane] = Z[s.CMD_ETA, lane]
        Z[s.V_ALTITUDE, lane] = Z[s.M_ALTITUDE, lane]
        Z[s.V_MASS, lane] = reference[k, ref.MASS]
    set_effectors(Z, width, vehicle.effector_mix)


@lanes
def tlc_attitude(Z, width, vehicle, earth, reference, gains, settings, k, dt, first):
    """Compute sub-loops 3 and 4 and the control allocation: deflection commands."""
    constants = vehicle.constants
    mass = reference[k, ref.MASS]
    wd_attitude = settings[0]
    wd_rate = settings[1]
    aileron_min = settings[5]
    aileron_max = settings[6]
    rudder_min = settings[7]
    rudder_max = settings[8]
    elevator_min = settings[9]
    elevator_max = settings[10]
    decay_attitude = exp(-wd_attitude * dt)
    decay_rate = exp(-wd_rate * dt)
    g = gains[k]
    attitude_spectrum = Spectrum(*six_from(g, TLC_ATTITUDE))
    rate_spectrum = Spectrum(*six_from(g, TLC_RATE))
    for lane in range(width):
        speed = Z[s.M_SPEED, lane]
        q_bar = 0.5 * Z[RHO_NOM, lane] * speed * speed
        q_s = q_bar * constants.area
        alpha_cmd = Z[s.ALPHA_CMD, lane]
        bank_cmd = Z[s.BANK_CMD, lane]
        sin_a, cos_a = sincos(alpha_cmd)
        sin_s, cos_s = sincos(bank_cmd)
        sin_g, cos_g = sincos(Z[s.M_GAMMA, lane])
        radius = earth.equatorial_radius + Z[s.M_ALTITUDE, lane]
        gravity_speed = earth.gravitational_parameter / (radius * radius * speed)

        # Sub-loop 3 is linearized about the commands, including the inclination of the thrust.
        t = q_s * Z[T_THRUST, lane]
        t_slope = q_s * Z[T_THRUST_SLOPE, lane]
        sin_ae = sin_a * constants.thrust_cos + cos_a * constants.thrust_sin
        cos_ae = cos_a * constants.thrust_cos - sin_a * constants.thrust_sin
        side_slope = side_force_slope(
            constants, q_s, Z[SLOPES + 2 * N_INPUTS + 3, lane], Z[T_DRAG, lane]
        )
        point = AttitudePoint(
            mass * speed,
            gravity_speed,
            sin_a,
            cos_a,
            sin_s,
            cos_s,
            cos_g,
            sin_g / cos_g,
            q_s * Z[T_LIFT, lane] + t * sin_ae,
            q_s * Z[T_LIFT_SLOPE, lane] + t_slope * sin_ae + t * cos_ae,
            t * cos_ae,
            0.0,
            side_slope,
        )
        d_alpha = alpha_cmd if first else Z[D_ALPHA, lane]
        d_bank = bank_cmd if first else Z[D_BANK, lane]
        alpha_dot = differentiator_output(wd_attitude, d_alpha, alpha_cmd)
        bank_dot = differentiator_output(wd_attitude, d_bank, bank_cmd)
        Z[D_ALPHA, lane] = differentiator_next(decay_attitude, d_alpha, alpha_cmd)
        Z[D_BANK, lane] = differentiator_next(decay_attitude, d_bank, bank_cmd)
        p_nom, q_nom, r_nom = attitude_inverse(point, alpha_dot, 0.0, bank_dot)
        # The sums are written out, because calls of dot6 would prevent SIMD code, which is 5 times
        # faster.
        k, m, n = attitude_gains(point, p_nom, r_nom, attitude_spectrum)
        alpha_err = Z[s.M_ALPHA, lane] - alpha_cmd
        beta_err = Z[s.M_BETA, lane]
        bank_err = wrap(Z[s.M_BANK, lane] - bank_cmd)
        int_alpha = Z[I_ATTITUDE, lane] + dt * alpha_err
        int_beta = Z[I_ATTITUDE + 1, lane] + dt * beta_err
        int_bank = Z[I_ATTITUDE + 2, lane] + dt * bank_err
        p_cmd = p_nom - (
            k[0] * int_alpha
            + k[1] * alpha_err
            + k[2] * int_beta
            + k[3] * beta_err
            + k[4] * int_bank
            + k[5] * bank_err
        )
        q_cmd = q_nom - (
            m[0] * int_alpha
            + m[1] * alpha_err
            + m[2] * int_beta
            + m[3] * beta_err
            + m[4] * int_bank
            + m[5] * bank_err
        )
        r_cmd = r_nom - (
            n[0] * int_alpha
            + n[1] * alpha_err
            + n[2] * int_beta
            + n[3] * beta_err
            + n[4] * int_bank
            + n[5] * bank_err
        )

        # Sub-loop 4 is linearized about the commanded rates.
        d_p = p_cmd if first else Z[D_P, lane]
        d_q = q_cmd if first else Z[D_Q, lane]
        d_r = r_cmd if first else Z[D_R, lane]
        p_dot = differentiator_output(wd_rate, d_p, p_cmd)
        q_dot = differentiator_output(wd_rate, d_q, q_cmd)
        r_dot = differentiator_output(wd_rate, d_r, r_cmd)
        Z[D_P, lane] = differentiator_next(decay_rate, d_p, p_cmd)
        Z[D_Q, lane] = differentiator_next(decay_rate, d_q, q_cmd)
        Z[D_R, lane] = differentiator_next(decay_rate, d_r, r_cmd)
        inertia = Inertia(
            Z[s.INERTIA_XX, lane],
            Z[s.INERTIA_YY, lane],
            Z[s.INERTIA_ZZ, lane],
            Z[s.INERTIA_13, lane],
        )
        m_x, m_y, m_z = moment_inverse(inertia, p_cmd, q_cmd, r_cmd, p_dot, q_dot, r_dot)
        k, m, n = rate_gains(inertia, p_cmd, q_cmd, r_cmd, rate_spectrum)
        p_err = Z[s.M_P, lane] - p_cmd
        q_err = Z[s.M_Q, lane] - q_cmd
        r_err = Z[s.M_R, lane] - r_cmd
        int_p = Z[I_RATE, lane] + dt * p_err
        int_q = Z[I_RATE + 1, lane] + dt * q_err
        int_r = Z[I_RATE + 2, lane] + dt * r_err
        m_x -= (
            k[0] * int_p + k[1] * p_err + k[2] * int_q + k[3] * q_err + k[4] * int_r + k[5] * r_err
        )
        m_y -= (
            m[0] * int_p + m[1] * p_err + m[2] * int_q + m[3] * q_err + m[4] * int_r + m[5] * r_err
        )
        m_z -= (
            n[0] * int_p + n[1] * p_err + n[2] * int_q + n[3] * q_err + n[4] * int_r + n[5] * r_err
        )

        # Allocation (19) uses the moment required in addition to the moment of the last commands.
        now_x, now_y, now_z = nominal_moment(Z, lane, constants, Z[RHO_NOM, lane], q_bar, speed)
        a_x, a_y, a_z = moment_slope(Z, lane, constants, q_bar, SLOPES, 0)
        b_x, b_y, b_z = moment_slope(Z, lane, constants, q_bar, SLOPES, 1)
        c_x, c_y, c_z = moment_slope(Z, lane, constants, q_bar, SLOPES, 2)
        da, dr, de = solve_3x3(
            a_x, b_x, c_x, a_y, b_y, c_y, a_z, b_z, c_z, m_x - now_x, m_y - now_y, m_z - now_z
        )
        aileron = Z[s.CMD_AILERON, lane] + da
        rudder = Z[s.CMD_RUDDER, lane] + dr
        elevator = Z[s.CMD_ELEVATOR, lane] + de
        aileron_cmd = clamp(aileron, aileron_min, aileron_max)
        rudder_cmd = clamp(rudder, rudder_min, rudder_max)
        elevator_cmd = clamp(elevator, elevator_min, elevator_max)
        Z[s.CMD_AILERON, lane] = aileron_cmd
        Z[s.CMD_RUDDER, lane] = rudder_cmd
        Z[s.CMD_ELEVATOR, lane] = elevator_cmd
        # Anti-windup freezes the integrators of axes whose deflection is at its limit.
        pitch_free = elevator_cmd == elevator
        lateral_free = aileron_cmd == aileron and rudder_cmd == rudder
        Z[I_ATTITUDE, lane] = int_alpha if pitch_free else Z[I_ATTITUDE, lane]
        Z[I_RATE + 1, lane] = int_q if pitch_free else Z[I_RATE + 1, lane]
        Z[I_ATTITUDE + 1, lane] = int_beta if lateral_free else Z[I_ATTITUDE + 1, lane]
        Z[I_ATTITUDE + 2, lane] = int_bank if lateral_free else Z[I_ATTITUDE + 2, lane]
        Z[I_RATE, lane] = int_p if lateral_free else Z[I_RATE, lane]
        Z[I_RATE + 2, lane] = int_r if lateral_free else Z[I_RATE + 2, lane]


@lanes
def nominal_forces(plan, memory, width, active):
    """Compute the nominal vehicle's coefficients, thrust and FIXED_TABLE_ROWS."""
    Z = memory.Z
    T = memory.T
    vehicle = plan.vehicle
    look_up(Z, T, width, vehicle.tables, memory.cells)
    if active is not None and plan.user_code.propulsion != 0:
        nominal_thrust(Z, width, vehicle, plan.user_code, RHO_NOM, s.M_SPEED)
    if active is not None and plan.user_code.aerodynamics != 0:
        nominal_coefficients(Z, width, vehicle, plan.user_code, RHO_NOM, s.M_SPEED)
    else:
        build_up(Z, T, width, vehicle.build_up, plan.unit_factors)


@lanes
def nominal_vehicle(plan, memory, width, active):
    """Call :func:`nominal_forces`; store coefficient slopes in rows starting at ``SLOPES``."""
    Z = memory.Z
    T = memory.T
    vehicle = plan.vehicle
    nominal_forces(plan, memory, width, active)
    if active is not None and plan.user_code.aerodynamics != 0:
        nominal_slopes(Z, width, vehicle, plan.user_code, SLOPES)
    else:
        table_slopes(T, width, vehicle.tables, plan.effectiveness, memory.cells, memory.high)
        slopes_of_coefficients(Z, T, width, plan.effectiveness, SLOPES)


@lanes
def tlc_tick(plan, memory, width, active, tick):
    """Compute the commands from the measurement at a control tick.

    ``active`` is None for vehicles without custom functions.
    """
    Z = memory.Z
    vehicle = plan.vehicle
    reference = plan.reference
    gains = plan.gains
    settings = plan.settings
    dt = plan.timing.step * plan.timing.steps_per_tick
    tlc_guidance(Z, width, vehicle, reference, gains, settings, tick, dt)
    nominal_variables(Z, width, vehicle, reference, tick)
    nominal_vehicle(plan, memory, width, active)
    look_up_trim(Z, width, plan.trim_tables, memory.trim, s.ALPHA_CMD, s.CMD_ETA, T_LIFT)
    tlc_attitude(Z, width, vehicle, plan.earth, reference, gains, settings, tick, dt, tick == 0)
