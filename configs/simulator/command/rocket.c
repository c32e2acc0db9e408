/* Vertical flight of a sounding rocket with a target apogee of 3000 m; air brakes prevent a higher apogee.
 *
 * The program reads one flight from each line of standard input, such as
 *   {"inputs": {"mass": 20.1, "drag": 0.98}, "settings": {"brakes": "timed"}, "flight": "9e3779b9"}
 * and replies with one line of JSON that repeats "flight". A program may also use a JSON library.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define GRAVITY 9.81 /* m/s2 */
#define TARGET 3000.0 /* m */
#define STEP 0.02 /* s */
#define THRUST 2100.0 /* N */
#define BURN 3.6 /* s */
#define BODY 0.0082 /* drag area of the rocket, m2 */
#define BRAKES 0.006 /* additional drag area of the open brakes, m2 */

static double number(const char *line, const char *name) {
    const char *at = strstr(line, name);
    return at ? strtod(at + strlen(name), NULL) : NAN; /* a missing number gives NaN, so the flight fails to run */
}

/* Control law under test: opens the brakes on a time schedule, or if the predicted apogee is too high. */
static int brakes_open(const char *line, double time, double height, double speed, double mass) {
    if (strstr(line, "\"brakes\": \"timed\""))
        return number(line, "\"from\":") <= time && time < number(line, "\"to\":");
    double k = 0.5 * 1.225 * exp(-height / 9000.0) * BODY / mass;
    return height + log(1.0 + k * speed * speed / GRAVITY) / (2.0 * k) > TARGET;
}

int main(void) {
    char line[4096];
    while (fgets(line, sizeof line, stdin)) {
        double mass = number(line, "\"mass\":"), drag = number(line, "\"drag\":");
        double more = number(line, "\"thrust\":"), altimeter = number(line, "\"altimeter\":");
        double time = 0.0, height = 0.0, speed = 0.0, load = 0.0;
        while (time < BURN || speed > 0.0) {
            double density = 1.225 * exp(-height / 9000.0);
            double thrust = 0.0, area = BODY * drag;
            if (time < BURN)
                thrust = THRUST * more;
            else if (brakes_open(line, time, height * altimeter, speed, mass))
                area += BRAKES;
            double force = thrust - 0.5 * density * speed * speed * area;
            speed += (force / mass - GRAVITY) * STEP;
            height += speed * STEP;
            time += STEP;
            load = fmax(load, fabs(force / mass) / GRAVITY);
        }
        /* Each request ends with "flight": "TEXT"}, and so does the reply, which identifies the flight. */
        const char *flight = strstr(line, "\"flight\": ");
        printf("{\"apogee\": %.17g, \"apogee_miss\": %.17g, \"load_max\": %.17g, \"end_time\": %.17g, %s", height,
               fabs(height - TARGET), load, time, flight ? flight : "\"error\": \"no flight\"}\n");
        fflush(stdout); /* send each reply immediately, because a later flight may crash */
    }
    return 0;
}
