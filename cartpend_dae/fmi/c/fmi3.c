/* FMI 3.0 around an instance. */
#if defined(FMI3_STATIC)
#define FMI3_FUNCTION_PREFIX FMI3_STATIC
#endif
#include <stdbool.h>

#include "fmi3Functions.h"

#define ENTER(phases, name)                                                                                            \
    int status;                                                                                                        \
    Instance *c = allowed(instance, phases, name, &status);                                                            \
    if (!c)                                                                                                            \
        return (fmi3Status)status

#define WANT(condition, what)                                                                                          \
    if (!(condition))                                                                                                  \
    return (fmi3Status)refuse(c, ERROR, "%s", what)

static void say3(Instance *c, int status, const char *category, const char *sentence) {
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)c->callback;
    if (logger && (status == ERROR || status == WARNING ? (status == ERROR ? c->logs_errors : c->logs_warnings)
                                                        : c->is_logging))
        logger(c->environment, (fmi3Status)status, category, sentence);
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    ENTER(ANY_PHASE, "fmi3SetDebugLogging");
    int errors = n == 0, warnings = n == 0;
    WANT(n == 0 || categories, "The log categories are missing.");
    for (size_t k = 0; k < n; k++) {
        if (categories[k] && !strcmp(categories[k], "logStatusError"))
            errors = 1;
        else if (categories[k] && !strcmp(categories[k], "logStatusWarning"))
            warnings = 1;
        else
            return (fmi3Status)refuse(c, ERROR, "There is no log category `%s`.", categories[k] ? categories[k] : "");
    }
    c->is_logging = on;
    c->logs_errors = on ? errors : 1;
    c->logs_warnings = on ? warnings : 1;
    return fmi3OK;
}

static fmi3Instance instantiated(fmi3String name, fmi3String token, fmi3Boolean on, fmi3InstanceEnvironment environment,
                                 fmi3LogMessageCallback log, const State *how, fmi3IntermediateUpdateCallback update,
                                 const char *refusal) {
    Instance *like = calloc(1, sizeof *like);
    void *handle = NULL;
    if (!like)
        return NULL;
    like->say = say3;
    like->logs_errors = like->logs_warnings = 1;
    like->is_logging = on;
    like->callback = (void (*)(void))log;
    like->intermediate = (void (*)(void))update;
    like->environment = environment;
    like->state = *how;
    if (refusal)
        refuse(like, ERROR, "%s was exported without %s.", MODEL_NAME, refusal);
    else
        handle = new_instance(like, name, token);
    free(like);
    return handle;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean on, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    static const State how;
    (void)resources, (void)visible;
    return instantiated(name, token, on, environment, log, &how, NULL, HAS_ME ? NULL : "model exchange");
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean on, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    State *how = calloc(1, sizeof *how);
    (void)resources, (void)visible, (void)required, (void)n_required;
    if (!how)
        return NULL;
    how->is_cs = 1;
    how->event_mode_used = event_mode;
    how->early_return_allowed = early_return;
    fmi3Instance made = instantiated(name, token, on, environment, log, how, update, HAS_CS ? NULL : "co-simulation");
    free(how);
    return made;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean on, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    static const State how;
    (void)resources, (void)visible, (void)update, (void)lock, (void)unlock;
    return instantiated(name, token, on, environment, log, &how, NULL, "scheduled execution");
}

void fmi3FreeInstance(fmi3Instance instance) { free_handle(instance, INSTANCE); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
    ENTER(INSTANTIATED, "fmi3EnterInitializationMode");
    WANT(isfinite(start) && (!has_stop || stop >= start), "The start time must be finite, and not after the stop time.");
    WANT(!has_tolerance || (isfinite(tolerance) && tolerance > 0), "The tolerance must be positive.");
    c->state.time = c->state.start_time = start;
    if (has_tolerance)
        c->state.tolerance = tolerance;
    c->state.is_started = 0;
    c->state.phase = INITIALIZATION_MODE;
    changed(c);
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    ENTER(INITIALIZATION_MODE, "fmi3ExitInitializationMode");
    if ((status = solve_start(c)) != OK)
        return (fmi3Status)status;
#if HAS_CS
    if (c->state.is_cs) {
        if ((status = begin_steps(c)) == OK)
            c->state.phase = c->state.event_mode_used ? EVENT_MODE : STEP_MODE;
        return (fmi3Status)status;
    }
#endif
    c->state.phase = EVENT_MODE;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    ENTER(CONTINUOUS_MODE | STEP_MODE, "fmi3EnterEventMode");
    WANT(!c->state.is_cs || c->state.event_mode_used, "The instance was made without event mode.");
    c->state.phase = EVENT_MODE;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    ENTER(EVENT_MODE | CONTINUOUS_MODE | STEP_MODE, "fmi3Terminate");
    c->state.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    ENTER(ANY_PHASE, "fmi3Reset");
    reset(c);
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *where) {
    ENTER(ANY_PHASE, "fmi3GetFMUState");
    return (fmi3Status)save(c, where);
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState kept) {
    ENTER(ANY_PHASE, "fmi3SetFMUState");
    return (fmi3Status)restore(c, kept);
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *where) {
    ENTER(ANY_PHASE, "fmi3FreeFMUState");
    return (fmi3Status)forget(c, where);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState kept, size_t *size) {
    ENTER(ANY_PHASE, "fmi3SerializedFMUStateSize");
    return (fmi3Status)n_bytes(c, kept, size);
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState kept, fmi3Byte bytes[], size_t size) {
    ENTER(ANY_PHASE, "fmi3SerializeFMUState");
    return (fmi3Status)write_bytes(c, kept, bytes, size);
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size, fmi3FMUState *where) {
    ENTER(ANY_PHASE, "fmi3DeserializeFMUState");
    return (fmi3Status)read_bytes(c, bytes, size, where);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | STEP_MODE | TERMINATED, "fmi3GetDirectionalDerivative");
    WANT(n_seed == n_knowns && n_sensitivity == n_unknowns && (!n_unknowns || (unknowns && sensitivity)) &&
             (!n_knowns || (knowns && seed)),
         "The references, seeds or sensitivities are missing or of a wrong number.");
    return (fmi3Status)directional(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | STEP_MODE | TERMINATED, "fmi3GetAdjointDerivative");
    WANT(n_seed == n_unknowns && n_sensitivity == n_knowns && (!n_unknowns || (unknowns && seed)) &&
             (!n_knowns || (knowns && sensitivity)),
         "The references, seeds or sensitivities are missing or of a wrong number.");
    return (fmi3Status)adjoint(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

#include "fmi3_values.c"
#include "fmi3_model_exchange.c"
#include "fmi3_co_simulation.c"
