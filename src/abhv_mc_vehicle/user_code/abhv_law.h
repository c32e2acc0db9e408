/* Interface of a control law in C. All values are doubles in SI units and radians.
 *
 * Each call computes one flight at one control tick. The law keeps its memory only in `state`, because many flights
 * are simulated at the same time and in any order. The functions return 0; any other value ends the flight with the
 * outcome law_failed.
 */
#ifndef ABHV_LAW_H
#define ABHV_LAW_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "abhv_settings.h" /* struct abhv_settings, generated from the settings in the controller file */

#ifdef __cplusplus
extern "C" {
#endif

@ONBOARD@typedef struct { /* measured quantities */
@MEASURED@
} abhv_measured;

typedef struct { /* reference of the mission and nominal quantities along it, at this tick */
@REFERENCE@
} abhv_reference;

typedef struct { /* metrics compare the flight with the last three values; by default, these are the reference's */
@COMMAND@
    double effectors[@MOST@]; /* rad, in the order of the controller file; effectors not set follow the axis commands */
} abhv_command;

size_t abhv_law_state_size(void);
int abhv_law_init(const abhv_settings *settings, const abhv_reference *first, void *state); /* state is initially zero */
int abhv_law_step(const abhv_measured *measured, const abhv_reference *reference, const double *gains,
                  const abhv_settings *settings, double time, double dt, void *state, abhv_command *command);

/* Optional functions for margins and linear models; define both or neither. abhv_law_state_get returns the number of
 * values in the memory, and writes the values if `values` is not NULL. They must include everything that
 * abhv_law_step remembers. */
int abhv_law_state_get(const void *state, double *values);
int abhv_law_state_set(void *state, const double *values);

/* ID of the interface with which the law was built. A library with another interface is rejected. */
__attribute__((weak, visibility("default"))) const char abhv_law_interface[] = "@INTERFACE@ " ABHV_SETTINGS;

#ifdef __cplusplus
}
#endif

/* These functions give the same bits as the compiled simulation if the law is built with -ffp-contract=off. */

static inline double abhv_clamp(double x, double low, double high) {
    x = x < low ? low : x;
    return x > high ? high : x;
}

static inline double abhv_wrap(double angle) { /* angle in [-pi, pi]; the argument must lie in [-3 pi, 3 pi] */
    angle = angle > 3.141592653589793 ? angle - 2.0 * 3.141592653589793 : angle;
    return angle < -3.141592653589793 ? angle + 2.0 * 3.141592653589793 : angle;
}

static inline void abhv_sincos(double x, double *sin_x, double *cos_x) { /* valid up to 1048576 rad; NaN beyond this limit */
    double rounded = x * 0.6366197723675814 + 6755399441055744.0;
    double n = rounded - 6755399441055744.0;
    int64_t bits;
    memcpy(&bits, &rounded, sizeof bits);
    int quadrant = (int)(bits & 3);
    double a = x - n * @HALF_PI0@;
    double b = -(n * @HALF_PI1@);
    double c = a + b;
    double part = c - a;
    double tail = ((a - (c - part)) + (b - part)) - n * @HALF_PI2@;
    double r = c + tail;
    tail = (c - r) + tail;
    double z = r * r;
    double z2 = z * z;
    double half_z = 0.5 * z;
    double s = (@SIN1@ + z * @SIN2@) +
               z2 * ((@SIN3@ + z * @SIN4@) + z2 * @SIN5@);
    double r3 = z * r;
    double sine = r - ((z * (0.5 * tail - r3 * s) - tail) - r3 * @SIN0@);
    double p = (@COS0@ + z * @COS1@) +
               z2 * ((@COS2@ + z * @COS3@) +
                     z2 * (@COS4@ + z * @COS5@));
    double w = 1.0 - half_z;
    double cosine = w + (((1.0 - w) - half_z) + (z2 * p - r * tail));
    double swapped = quadrant & 1 ? cosine : sine;
    double other = quadrant & 1 ? sine : cosine;
    swapped = quadrant & 2 ? -swapped : swapped;
    other = (quadrant + 1) & 2 ? -other : other;
    int valid = x <= 1048576.0 && x >= -1048576.0;
    *sin_x = valid ? swapped : (0.0 / 0.0);
    *cos_x = valid ? other : (0.0 / 0.0);
}

#endif
