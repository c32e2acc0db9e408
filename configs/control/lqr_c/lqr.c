/* Built-in LQR as a control law in C: guidance, longitudinal and lateral attitude (Zhu and Shen 2014, (22), (23)). */
#include "abhv_law.h"

enum gain { /* columns of lqr_design.py: u = nominal - K (x - nominal) */
    GUIDANCE = 0, /* angle of attack, bank and equivalence ratio, each by altitude, path, heading and speed */
    ELEVATOR = 12, /* by angle of attack, pitch rate */
    AILERON = 14, /* by bank, sideslip, roll rate, yaw rate */
    RUDDER = 18,
    EARTH_RADIUS = 22,
    GRAVITATIONAL_PARAMETER = 23
};

size_t abhv_law_state_size(void) { return 0; } /* a law without memory */

int abhv_law_init(const abhv_settings *settings, const abhv_reference *first, void *state) {
    (void)settings, (void)first, (void)state;
    return 0;
}

int abhv_law_step(const abhv_measured *measured, const abhv_reference *reference, const double *gains,
                  const abhv_settings *settings, double time, double dt, void *state, abhv_command *command) {
    (void)time, (void)dt, (void)state;
    const double *k = gains + GUIDANCE, *e = gains + ELEVATOR, *a = gains + AILERON, *r = gains + RUDDER;

    double altitude = measured->altitude - reference->altitude;
    double path = measured->flight_path_angle - reference->flight_path_angle;
    double heading = abhv_wrap(measured->heading - reference->heading);
    double speed = measured->speed - reference->speed;
    double alpha = k[0] * altitude + k[1] * path + k[2] * heading + k[3] * speed;
    double bank = k[4] * altitude + k[5] * path + k[6] * heading + k[7] * speed;
    double eta = k[8] * altitude + k[9] * path + k[10] * heading + k[11] * speed;
    double alpha_cmd = abhv_clamp(reference->angle_of_attack - alpha, settings->angle_of_attack[0],
                                  settings->angle_of_attack[1]);
    double bank_cmd = abhv_clamp(reference->bank - bank, -settings->bank_limit, settings->bank_limit);

    /* Rates of the coordinated turn, rotated by alpha from stability axes to body axes. */
    double radius = gains[EARTH_RADIUS] + measured->altitude;
    double gravity_speed = gains[GRAVITATIONAL_PARAMETER] / (radius * radius * measured->speed);
    double sin_bank, cos_bank, sin_alpha, cos_alpha;
    abhv_sincos(bank_cmd, &sin_bank, &cos_bank);
    abhv_sincos(alpha_cmd, &sin_alpha, &cos_alpha);
    double turn = gravity_speed * sin_bank;
    double pitch_rate = measured->pitch_rate - turn * sin_bank / cos_bank;
    double roll_rate = measured->roll_rate + turn * sin_alpha;
    double yaw_rate = measured->yaw_rate - turn * cos_alpha;
    double alpha_err = measured->angle_of_attack - alpha_cmd;
    double bank_err = abhv_wrap(measured->bank - bank_cmd);
    double beta = measured->sideslip;

    command->aileron = -(a[0] * bank_err + a[1] * beta + a[2] * roll_rate + a[3] * yaw_rate);
    command->rudder = -(r[0] * bank_err + r[1] * beta + r[2] * roll_rate + r[3] * yaw_rate);
    command->elevator = reference->elevator - (e[0] * alpha_err + e[1] * pitch_rate);
    command->equivalence_ratio = reference->equivalence_ratio - eta;
    command->flight_path_angle = reference->flight_path_angle;
    command->angle_of_attack = alpha_cmd;
    command->bank = bank_cmd;
    return 0;
}
