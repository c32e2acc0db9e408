#include <stdio.h>

struct request { /* in the order of `inputs` */
    double angle, path, bank, sideslip, p, q, r, speed;
    double ref_angle, ref_path, ref_bank, ref_speed, ref_throttle, ref_elevator;
};
struct reply { double aileron, rudder, elevator, throttle; }; /* in the order of `outputs` */

int main(void) {
    struct request in;
    double distance = 0.0; /* a process computes one flight, so variables are memory of this flight */
    while (fread(&in, sizeof in, 1, stdin) == 1) {
        double angle = in.angle - in.ref_angle + 0.9 * (in.path - in.ref_path);
        double bank = in.bank - in.ref_bank, speed = in.speed - in.ref_speed;
        struct reply out = {
            -0.26 * bank - 1.2 * in.sideslip - 0.08 * in.p + 0.06 * in.r,
            -0.04 * bank - 0.2 * in.sideslip - 0.01 * in.p + 0.04 * in.r,
            in.ref_elevator + 2.0 * angle + 1.5 * in.q,
            in.ref_throttle - 0.02 * speed - 0.001 * distance,
        };
        distance += 0.01 * speed;
        fwrite(&out, sizeof out, 1, stdout);
        fflush(stdout);
    }
    return 0;
}
