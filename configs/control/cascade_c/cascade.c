/* A control law of one's own in C: a cascade of loops for path, attitude and body rates, as ../cascade.py.
 *
 * A flight calls abhv_law_step at every control tick. Everything is a double in SI and radians. Structs and functions
 * are those of abhv_law.h, `abhv_settings` is written from the YAML file beside this one.
 */
#include "abhv_law.h"

#define GRAVITY 9.73 /* m/s2, at 20 km */

enum gain { /* columns of the design: the fields of Gains in the Python file that the YAML file names */
    ELEVATOR_BY_ANGLE_OF_ATTACK,
    ELEVATOR_BY_PITCH_RATE,
    AILERON_BY_BANK,
    AILERON_BY_SIDESLIP,
    AILERON_BY_ROLL_RATE,
    AILERON_BY_YAW_RATE,
    RUDDER_BY_BANK,
    RUDDER_BY_SIDESLIP,
    RUDDER_BY_ROLL_RATE,
    RUDDER_BY_YAW_RATE
};

typedef struct { /* what the law keeps from tick to tick; nothing else may be kept: no statics, no globals */
    double altitude; /* integral of the altitude error, m s */
    double speed;    /* integral of the speed error, m */
} memory;

size_t abhv_law_state_size(void) { return sizeof(memory); }

int abhv_law_init(const abhv_settings *settings, const abhv_reference *first, void *state) {
    (void)settings, (void)first, (void)state; /* the state holds zeros */
    return 0;
}

int abhv_law_step(const abhv_measured *measured, const abhv_reference *reference, const double *gains,
                  const abhv_settings *settings, double time, double dt, void *state, abhv_command *command) {
    memory *kept = state;
    (void)time;

    /* Path: altitude to flight path angle, that to angle of attack; heading to bank; speed to equivalence ratio. */
    double rise = measured->altitude - reference->altitude;
    double speed = measured->speed - reference->speed;
    double path_cmd = reference->flight_path_angle
                      - settings->altitude * (rise + 0.05 * kept->altitude) / measured->speed;
    double alpha = reference->angle_of_attack - settings->path * (measured->flight_path_angle - path_cmd);
    alpha = abhv_clamp(alpha, settings->angle_of_attack[0], settings->angle_of_attack[1]);
    double turn = -settings->heading * abhv_wrap(measured->heading - reference->heading);
    double sin_bank, cos_bank;
    abhv_sincos(reference->bank, &sin_bank, &cos_bank);
    double bank = reference->bank + turn * measured->speed / GRAVITY * cos_bank * cos_bank;
    bank = abhv_clamp(bank, -settings->bank_limit, settings->bank_limit);

    /* Attitude and rates: state feedback about the coordinated turn. */
    double turning = GRAVITY / measured->speed * bank; /* rad/s, about the vertical, small angles */
    double alpha_error = measured->angle_of_attack - alpha;
    double bank_error = abhv_wrap(measured->bank - bank);
    double pitch = measured->pitch_rate - turning * bank;
    double yaw = measured->yaw_rate - turning;
    double beta = measured->sideslip, roll = measured->roll_rate;

    /* The commands, kept within the vehicle's limits for you. The last three are what the report compares with. */
    command->elevator = reference->elevator - gains[ELEVATOR_BY_ANGLE_OF_ATTACK] * alpha_error
                        - gains[ELEVATOR_BY_PITCH_RATE] * pitch;
    command->aileron = -(gains[AILERON_BY_BANK] * bank_error + gains[AILERON_BY_SIDESLIP] * beta
                         + gains[AILERON_BY_ROLL_RATE] * roll + gains[AILERON_BY_YAW_RATE] * yaw);
    command->rudder = -(gains[RUDDER_BY_BANK] * bank_error + gains[RUDDER_BY_SIDESLIP] * beta
                        + gains[RUDDER_BY_ROLL_RATE] * roll + gains[RUDDER_BY_YAW_RATE] * yaw);
    command->equivalence_ratio = reference->equivalence_ratio - settings->speed * (speed + 0.1 * kept->speed);
    command->flight_path_angle = path_cmd;
    command->angle_of_attack = alpha;
    command->bank = bank;

    kept->altitude = abhv_clamp(kept->altitude + dt * rise, -1000.0, 1000.0);
    kept->speed = abhv_clamp(kept->speed + dt * speed, -100.0, 100.0);
    return 0; /* anything else ends the flight as law_failed */
}

/* Optional: with both, margins and linear models know the law's memory. */
int abhv_law_state_get(const void *state, double *values) {
    if (values) memcpy(values, state, sizeof(memory));
    return 2;
}

int abhv_law_state_set(void *state, const double *values) {
    memcpy(state, values, sizeof(memory));
    return 0;
}
