/* Custom control law in C with two sample rates: guidance at 10 Hz, attitude and body rates at 100 Hz. The gains are
 * those of ../cascade.py.
 *
 * The simulation calls abhv_law_step at every control tick. All values are doubles in SI units and radians. The header
 * abhv_law.h declares the structs and functions; `abhv_settings` is generated from the YAML file next to this file.
 */
#include "abhv_law.h"

#define GRAVITY 9.73 /* m/s2, at 20 km */
#define EVERY 10     /* ticks between guidance updates; ticks are counted, because sums of dt are not exact */

enum gain { /* columns of the gains: the fields of Gains in the Python file that the YAML file names */
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

typedef struct { /* memory of the law between ticks; static and global variables must not be used */
    double altitude; /* integral of the altitude error, m s */
    double speed;    /* integral of the speed error, m */
    double tick;     /* ticks since the last guidance update */
    double path_cmd, alpha, bank, eta; /* commands of the last guidance update */
} memory;

size_t abhv_law_state_size(void) { return sizeof(memory); }

int abhv_law_init(const abhv_settings *settings, const abhv_reference *first, void *state) {
    (void)settings, (void)first, (void)state; /* the state is initially zero */
    return 0;
}

int abhv_law_step(const abhv_measured *measured, const abhv_reference *reference, const double *gains,
                  const abhv_settings *settings, double time, double dt, void *state, abhv_command *command) {
    memory *kept = state;
    (void)time;

    /* Guidance: altitude -> flight path angle -> angle of attack; heading -> bank; speed -> equivalence ratio. */
    if (kept->tick == 0.0) {
        double rise = measured->altitude - reference->altitude;
        double speed = measured->speed - reference->speed;
        double turn = -settings->heading * abhv_wrap(measured->heading - reference->heading);
        double sin_bank, cos_bank;
        abhv_sincos(reference->bank, &sin_bank, &cos_bank);
        kept->path_cmd = reference->flight_path_angle
                         - settings->altitude * (rise + 0.05 * kept->altitude) / measured->speed;
        kept->alpha = reference->angle_of_attack
                      - settings->path * (measured->flight_path_angle - kept->path_cmd);
        kept->alpha = abhv_clamp(kept->alpha, settings->angle_of_attack[0], settings->angle_of_attack[1]);
        kept->bank = reference->bank + turn * measured->speed / GRAVITY * cos_bank * cos_bank;
        kept->bank = abhv_clamp(kept->bank, -settings->bank_limit, settings->bank_limit);
        kept->eta = reference->equivalence_ratio - settings->speed * (speed + 0.1 * kept->speed);
        kept->altitude = abhv_clamp(kept->altitude + EVERY * dt * rise, -1000.0, 1000.0);
        kept->speed = abhv_clamp(kept->speed + EVERY * dt * speed, -100.0, 100.0);
    }
    kept->tick = kept->tick < EVERY - 1 ? kept->tick + 1.0 : 0.0;

    /* Attitude and body rates: state feedback about the coordinated turn. */
    double turning = GRAVITY / measured->speed * kept->bank; /* turn rate about the vertical for small angles, rad/s */
    double alpha_error = measured->angle_of_attack - kept->alpha;
    double bank_error = abhv_wrap(measured->bank - kept->bank);
    double pitch = measured->pitch_rate - turning * kept->bank;
    double yaw = measured->yaw_rate - turning;
    double beta = measured->sideslip, roll = measured->roll_rate;

    /* The simulation limits the commands to the vehicle's ranges. The report compares the flight with the last three. */
    command->elevator = reference->elevator - gains[ELEVATOR_BY_ANGLE_OF_ATTACK] * alpha_error
                        - gains[ELEVATOR_BY_PITCH_RATE] * pitch;
    command->aileron = -(gains[AILERON_BY_BANK] * bank_error + gains[AILERON_BY_SIDESLIP] * beta
                         + gains[AILERON_BY_ROLL_RATE] * roll + gains[AILERON_BY_YAW_RATE] * yaw);
    command->rudder = -(gains[RUDDER_BY_BANK] * bank_error + gains[RUDDER_BY_SIDESLIP] * beta
                        + gains[RUDDER_BY_ROLL_RATE] * roll + gains[RUDDER_BY_YAW_RATE] * yaw);
    command->equivalence_ratio = kept->eta;
    command->flight_path_angle = kept->path_cmd;
    command->angle_of_attack = kept->alpha;
    command->bank = kept->bank;

    return 0; /* any other value ends the flight with the outcome law_failed */
}

/* Optional: these two functions give margins and linear models access to the law's memory. */
int abhv_law_state_get(const void *state, double *values) {
    if (values) memcpy(values, state, sizeof(memory));
    return sizeof(memory) / sizeof(double);
}

int abhv_law_state_set(void *state, const double *values) {
    memcpy(state, values, sizeof(memory));
    return 0;
}
