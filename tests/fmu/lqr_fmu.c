/* The LQR of configs/control/lqr_c as an FMU of FMI_VERSION 2 or 3: its inputs are all that lqr.c is given. */
#include <stdlib.h>

#include "lqr.c"

enum { MEASURED, REFERENCE = MEASURED + sizeof(abhv_measured) / 8, GAINS = REFERENCE + sizeof(abhv_reference) / 8 };
enum { PARAMS = GAINS + 24, OUTPUTS = PARAMS + 3, SPEED = OUTPUTS + 7, RATE, MORE, TYPED = MORE + 4, COUNT = TYPED + 6 };
/* SPEED: a state, m. MORE: the vehicle's pitching moment, the last rudder, and the elevons' commands */
/* TYPED: enable, stage, gain; the elevator times the gain where enabled, whether the engine runs, and 2 */

typedef struct {
    double v[COUNT];
    double ticks;
} lqr;

static int tick(lqr *own, double time, double dt) {
    const double *v = own->v;
    if (v[MEASURED + 6] > 1.5) return 3; /* a bank that it does not fly */
    own->ticks += 1;
    int failed = abhv_law_step((const abhv_measured *)(v + MEASURED), (const abhv_reference *)(v + REFERENCE), v + GAINS,
                         (const abhv_settings *)(v + PARAMS), time, dt, 0, (abhv_command *)(own->v + OUTPUTS));
#ifdef REMEMBERS
    const abhv_measured *m = (const abhv_measured *)(v + MEASURED);
    own->v[SPEED] += dt * (m->speed - ((const abhv_reference *)(v + REFERENCE))->speed);
    own->v[OUTPUTS + 3] -= 0.001 * v[SPEED];
#endif
    own->v[MORE + 2] = v[OUTPUTS + 2] + 0.9 * v[OUTPUTS] + 1e-7 * v[MORE];
    own->v[MORE + 3] = v[OUTPUTS + 2] - v[OUTPUTS] + 0.1 * v[MORE + 1];
    if (v[TYPED + 1] != 0.0 && v[TYPED + 1] != -3.0) return 3; /* a stage that it does not know */
    own->v[TYPED + 3] = v[OUTPUTS + 2] * (v[TYPED] == 1.0 ? v[TYPED + 2] : 1.0);
    own->v[TYPED + 4] = own->v[TYPED + 5] = 1.0;
    return failed;
}

#if FMI_VERSION == 2
#include "fmi2Functions.h"

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String where,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)where, (void)functions, (void)visible, (void)logging;
    return calloc(1, sizeof(lqr));
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2Reset(fmi2Component c) {
    memset(c, 0, sizeof(lqr));
    return fmi2OK;
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s,
                               fmi2Real stop) {
    (void)c, (void)t, (void)tolerance, (void)s, (void)stop;
    return start >= 0.0 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return ((lqr *)c)->ticks == 0.0 ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((lqr *)c)->v[vr[i]] = value[i];
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((lqr *)c)->v[vr[i]];
    return fmi2OK;
}
#define KIND(NAME, TYPE)                                                                              \
    fmi2Status fmi2Set##NAME(fmi2Component c, const fmi2ValueReference r[], size_t n, const TYPE x[]) { \
        for (size_t i = 0; i < n; i++) ((lqr *)c)->v[r[i]] = x[i];                                    \
        return fmi2OK;                                                                                \
    }                                                                                                 \
    fmi2Status fmi2Get##NAME(fmi2Component c, const fmi2ValueReference r[], size_t n, TYPE x[]) {     \
        for (size_t i = 0; i < n; i++) x[i] = ((lqr *)c)->v[r[i]];                                    \
        return fmi2OK;                                                                                \
    }
KIND(Integer, fmi2Integer)
KIND(Boolean, fmi2Boolean)
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real dt, fmi2Boolean back) {
    (void)back;
    return tick(c, time, dt) ? fmi2Error : fmi2OK;
}
#else
#include "fmi3Functions.h"

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String where, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference needed[], size_t n, fmi3InstanceEnvironment us,
                                         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)where, (void)visible, (void)logging, (void)events, (void)early, (void)needed;
    (void)n, (void)us, (void)log, (void)update;
    return calloc(1, sizeof(lqr));
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3Reset(fmi3Instance c) {
    memset(c, 0, sizeof(lqr));
    return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean t, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean s, fmi3Float64 stop) {
    (void)t, (void)tolerance, (void)s, (void)stop;
    return start >= 0.0 && ((lqr *)c)->ticks == 0.0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 value[],
                          size_t count) {
    if (n != count) return fmi3Error;
    for (size_t i = 0; i < n; i++) ((lqr *)c)->v[vr[i]] = value[i];
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 value[],
                          size_t count) {
    if (n != count) return fmi3Error;
    for (size_t i = 0; i < n; i++) value[i] = ((lqr *)c)->v[vr[i]];
    return fmi3OK;
}
#define KIND(NAME)                                                                                        \
    fmi3Status fmi3Set##NAME(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##NAME x[], \
                             size_t m) {                                                                  \
        for (size_t i = 0; i < n; i++) ((lqr *)c)->v[r[i]] = x[i];                                        \
        return n == m ? fmi3OK : fmi3Error;                                                               \
    }                                                                                                     \
    fmi3Status fmi3Get##NAME(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##NAME x[],      \
                             size_t m) {                                                                  \
        for (size_t i = 0; i < n; i++) x[i] = ((lqr *)c)->v[r[i]];                                        \
        return n == m ? fmi3OK : fmi3Error;                                                               \
    }
KIND(Float32)
KIND(Int8)
KIND(UInt16)
KIND(Boolean)
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 dt, fmi3Boolean back, fmi3Boolean *event,
                      fmi3Boolean *terminate, fmi3Boolean *early, fmi3Float64 *last) {
    (void)back;
    *event = *terminate = *early = fmi3False;
    *last = time + dt;
    return tick(c, time, dt) ? fmi3Error : fmi3OK;
}
#endif
