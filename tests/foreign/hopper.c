/* A mass on a spring and damper with a force on it, which bounces off a wall at s = 0: FMI 2.0, model exchange.
   The parameter `misbehave` lets it crash (1), loop for ever (2) or refuse (3) at the first derivative after 0.1 s. */
#include "fmi2Functions.h"
#include <stdlib.h>
#include <string.h>

#ifndef GUID
#define GUID "{hopper}"
#endif

enum { S, V, DER_S, DER_V, FORCE, M, K, D, E, L, BOUNCES, MISBEHAVE, N };

typedef struct {
    double r[N], time;
    const fmi2CallbackFunctions *call;
} Hopper;

#define SELF Hopper *h = (Hopper *)c; if (!h) return fmi2Error

static fmi2Status rates(Hopper *h) {
    double *r = h->r;
    if (h->time > 0.1) {
        if (r[MISBEHAVE] == 1) { volatile int *nothing = NULL; *nothing = 1; }
        while (r[MISBEHAVE] == 2) { volatile int busy = 1; (void)busy; }
        if (r[MISBEHAVE] == 3) {
            h->call->logger(h->call->componentEnvironment, "hopper", fmi2Error, "error", "I refuse at %g s.", h->time);
            return fmi2Error;
        }
    }
    r[DER_S] = r[V];
    r[DER_V] = (r[FORCE] - r[D] * r[V] - r[K] * (r[S] - r[L])) / r[M];
    return fmi2OK;
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *call, fmi2Boolean visible, fmi2Boolean logging) {
    if (!guid || strcmp(guid, GUID)) {
        call->logger(call->componentEnvironment, name, fmi2Error, "error", "Wrong GUID.");
        return NULL;
    }
    Hopper *h = calloc(1, sizeof *h);
    const double start[N] = {1, 0, 0, 0, 0, 2, 8, 0.5, 0.7, 0.2, 0, 0};
    memcpy(h->r, start, sizeof start);
    h->call = call;
    return h;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean ed, fmi2Real e) {
    SELF; h->time = start; return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    SELF;
    if (rates(h) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < n; i++) { if (vr[i] >= N) return fmi2Error; value[i] = h->r[vr[i]]; }
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    SELF;
    for (size_t i = 0; i < n; i++) { if (vr[i] >= N) return fmi2Error; h->r[vr[i]] = value[i]; }
    return fmi2OK;
}
#define NONE(name, type, qualifier) \
    fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, qualifier type value[]) { return n ? fmi2Error : fmi2OK; }
#define NOTHING
NONE(fmi2GetInteger, fmi2Integer, NOTHING) NONE(fmi2GetBoolean, fmi2Boolean, NOTHING) NONE(fmi2GetString, fmi2String, NOTHING)
NONE(fmi2SetInteger, fmi2Integer, const) NONE(fmi2SetBoolean, fmi2Boolean, const) NONE(fmi2SetString, fmi2String, const)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) { return fmi2Error; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) { return fmi2Error; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) { return fmi2Error; }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) { return fmi2Error; }

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n,
                                        const fmi2ValueReference known[], size_t m, const fmi2Real seed[], fmi2Real out[]) {
    SELF;
    double d[N] = {0}, *r = h->r;
    for (size_t i = 0; i < m; i++) d[known[i]] = seed[i];
    rates(h);
    d[DER_S] = d[V];
    d[DER_V] = (d[FORCE] - d[D] * r[V] - r[D] * d[V] - d[K] * (r[S] - r[L]) - r[K] * (d[S] - d[L]) - r[DER_V] * d[M]) / r[M];
    for (size_t i = 0; i < n; i++) out[i] = d[unknown[i]];
    return fmi2OK;
}

fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    SELF;
    memset(info, 0, sizeof *info);
    if (h->r[S] <= 0 && h->r[V] < 0) {
        h->r[V] *= -h->r[E];
        h->r[BOUNCES] += 1;
        info->valuesOfContinuousStatesChanged = fmi2True;
    }
    return fmi2OK;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no, fmi2Boolean *event, fmi2Boolean *end) {
    *event = *end = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { SELF; h->time = time; return fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    SELF; if (n != 2) return fmi2Error; h->r[S] = x[0]; h->r[V] = x[1]; return fmi2OK;
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n) {
    SELF; if (n != 2 || rates(h) != fmi2OK) return fmi2Error; dx[0] = h->r[DER_S]; dx[1] = h->r[DER_V]; return fmi2OK;
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
    SELF; if (n != 1) return fmi2Error; z[0] = h->r[S]; return fmi2OK;
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    SELF; if (n != 2) return fmi2Error; x[0] = h->r[S]; x[1] = h->r[V]; return fmi2OK;
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    for (size_t i = 0; i < n; i++) x[i] = 1;
    return fmi2OK;
}
