"""LQR baseline controller for one control tick in all lanes: guidance and attitude.

The control law is from Zhu & Shen (2014), section 7, eqs. (22) and (23). The gains of each tick are
computed before the flight (abhv_mc_vehicle.control.design.lqr_design). Deviations are relative to
the reference and to the coordinated-turn rates.
"""

from abhv_mc_vehicle.kernel.jit import lanes
from abhv_mc_vehicle.kernel.laws import columns as ref
from abhv_mc_vehicle.kernel.laws.columns import LQR_ELEVATOR, LQR_GUIDANCE, LQR_LATERAL
from abhv_mc_vehicle.kernel.numerics.lane_math import clamp, sincos, wrap
from abhv_mc_vehicle.kernel.plant import state as s


@lanes
def lqr_tick(plan, memory, width, tick):
    """Compute the commands from the measurement at a control tick."""
    Z = memory.Z
    reference = plan.reference
    settings = plan.settings
    constants = plan.vehicle.constants
    k = plan.gains[tick]
    gravitational_parameter = plan.earth.gravitational_parameter
    for lane in range(width):
        altitude = Z[s.M_ALTITUDE, lane] - reference[tick, ref.ALTITUDE]
        path = Z[s.M_GAMMA, lane] - reference[tick, ref.FLIGHT_PATH_ANGLE]
        heading = wrap(Z[s.M_CHI, lane] - reference[tick, ref.HEADING])
        speed = Z[s.M_SPEED, lane] - reference[tick, ref.SPEED]
        g = LQR_GUIDANCE
        alpha = k[g] * altitude + k[g + 1] * path + k[g + 2] * heading + k[g + 3] * speed
        bank = k[g + 4] * altitude + k[g + 5] * path + k[g + 6] * heading + k[g + 7] * speed
        eta = k[g + 8] * altitude + k[g + 9] * path + k[g + 10] * heading + k[g + 11] * speed
        alpha_cmd = clamp(reference[tick, ref.ANGLE_OF_ATTACK] - alpha, settings[0], settings[1])
        bank_cmd = clamp(reference[tick, ref.BANK] - bank, -settings[2], settings[2])
        eta_cmd = clamp(
            reference[tick, ref.EQUIVALENCE_RATIO] - eta,
            constants.equivalence_ratio_min,
            constants.equivalence_ratio_max,
        )

        # rates of the coordinated turn, rotated by alpha from stability to body axes
        radius = plan.earth.equatorial_radius + Z[s.M_ALTITUDE, lane]
        gravity_speed = gravitational_parameter / (radius * radius * Z[s.M_SPEED, lane])
        sin_bank, cos_bank = sincos(bank_cmd)
        sin_alpha, cos_alpha = sincos(alpha_cmd)
        turn = gravity_speed * sin_bank
        pitch_rate = Z[s.M_Q, lane] - turn * sin_bank / cos_bank
        roll_rate = Z[s.M_P, lane] + turn * sin_alpha
        yaw_rate = Z[s.M_R, lane] - turn * cos_alpha
        alpha_err = Z[s.M_ALPHA, lane] - alpha_cmd
        bank_err = wrap(Z[s.M_BANK, lane] - bank_cmd)
        beta = Z[s.M_BETA, lane]
        e = LQR_ELEVATOR
        n = LQR_LATERAL
        elevator = reference[tick, ref.ELEVATOR] - (k[e] * alpha_err + k[e + 1] * pitch_rate)
        aileron = -(k[n] * bank_err + k[n + 1] * beta + k[n + 2] * roll_rate + k[n + 3] * yaw_rate)
        rudder = -(
            k[n + 4] * bank_err + k[n + 5] * beta + k[n + 6] * roll_rate + k[n + 7] * yaw_rate
        )
        Z[s.GAMMA_CMD, lane] = reference[tick, ref.FLIGHT_PATH_ANGLE]
        Z[s.ALPHA_CMD, lane] = alpha_cmd
        Z[s.BANK_CMD, lane] = bank_cmd
        Z[s.CMD_AILERON, lane] = clamp(aileron, settings[3], settings[4])
        Z[s.CMD_RUDDER, lane] = clamp(rudder, settings[5], settings[6])
        Z[s.CMD_ELEVATOR, lane] = clamp(elevator, settings[7], settings[8])
        Z[s.CMD_ETA, lane] = eta_cmd
