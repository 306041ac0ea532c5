/* FMI 2.0 around an instance. */
#if defined(FMI2_STATIC)
#define FMI2_FUNCTION_PREFIX FMI2_STATIC
#endif
#include "fmi2Functions.h"

#define ENTER(phases, name)                                                                                            \
    int status;                                                                                                        \
    Instance *c = allowed(component, phases, name, &status);                                                           \
    if (!c)                                                                                                            \
        return (fmi2Status)status

#define WANT(condition, what)                                                                                          \
    if (!(condition))                                                                                                  \
    return (fmi2Status)refuse(c, ERROR, "%s", what)

static void say2(Instance *c, int status, const char *category, const char *sentence) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)c->callback;
    if (logger && (status == ERROR || status == WARNING ? (status == ERROR ? c->logs_errors : c->logs_warnings)
                                                        : c->is_logging))
        logger(c->environment, c->name, (fmi2Status)status, category, "%s", sentence);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    ENTER(ANY_PHASE, "fmi2SetDebugLogging");
    int errors = n == 0, warnings = n == 0;
    WANT(n == 0 || categories, "The log categories are missing.");
    for (size_t k = 0; k < n; k++) {
        if (categories[k] && !strcmp(categories[k], "logStatusError"))
            errors = 1;
        else if (categories[k] && !strcmp(categories[k], "logStatusWarning"))
            warnings = 1;
        else
            return (fmi2Status)refuse(c, ERROR, "There is no log category `%s`.", categories[k] ? categories[k] : "");
    }
    c->is_logging = on;
    c->logs_errors = on ? errors : 1;
    c->logs_warnings = on ? warnings : 1;
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean on) {
    (void)resources, (void)visible;
    Instance *like = calloc(1, sizeof *like);
    void *handle = NULL;
    if (!like)
        return NULL;
    like->say = say2;
    like->logs_errors = like->logs_warnings = 1;
    like->is_logging = on;
    if (functions) {
        like->callback = (void (*)(void))functions->logger;
        like->environment = functions->componentEnvironment;
    }
    like->state.is_cs = type == fmi2CoSimulation;
    snprintf(like->name, sizeof like->name, "%s", name ? name : MODEL_NAME);
    if (like->state.is_cs ? !HAS_CS : !HAS_ME)
        refuse(like, ERROR, "%s was exported without %s.", MODEL_NAME, HAS_CS ? "model exchange" : "co-simulation");
    else
        handle = new_instance(like, name, guid);
    free(like);
    return handle;
}

void fmi2FreeInstance(fmi2Component component) { free_handle(component, INSTANCE); }

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
    ENTER(INSTANTIATED, "fmi2SetupExperiment");
    WANT(isfinite(start) && (!has_stop || stop >= start), "The start time must be finite, and not after the stop time.");
    WANT(!has_tolerance || (isfinite(tolerance) && tolerance > 0), "The tolerance must be positive.");
    c->state.time = c->state.start_time = start;
    if (has_tolerance)
        c->state.tolerance = tolerance;
    c->state.is_started = 0;
    changed(c);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component) {
    ENTER(INSTANTIATED, "fmi2EnterInitializationMode");
    c->state.phase = INITIALIZATION_MODE;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component) {
    ENTER(INITIALIZATION_MODE, "fmi2ExitInitializationMode");
    if ((status = solve_start(c)) != OK)
        return (fmi2Status)status;
#if HAS_CS
    if (c->state.is_cs) {
        if ((status = begin_steps(c)) != OK)
            return (fmi2Status)status;
        c->state.phase = STEP_MODE;
        return fmi2OK;
    }
#endif
    c->state.phase = EVENT_MODE;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component component) {
    ENTER(EVENT_MODE | CONTINUOUS_MODE | STEP_MODE, "fmi2Terminate");
    c->state.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component component) {
    ENTER(ANY_PHASE, "fmi2Reset");
    reset(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Real values[]) {
    ENTER(ANY_PHASE, "fmi2GetReal");
    WANT(!n || (vr && values), "The value references or values are missing.");
    for (size_t k = 0; k < n && status == OK; k++)
        status = get_value(c, vr[k], REAL, &values[k]);
    return (fmi2Status)status;
}

static fmi2Status get_whole(fmi2Component component, const fmi2ValueReference vr[], size_t n, int values[], int type,
                            const char *name) {
    ENTER(ANY_PHASE, name);
    WANT(!n || (vr && values), "The value references or values are missing.");
    for (size_t k = 0; k < n && status == OK; k++) {
        double value;
        if ((status = get_value(c, vr[k], type, &value)) == OK)
            values[k] = (int)value;
    }
    return (fmi2Status)status;
}

fmi2Status fmi2GetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Integer values[]) {
    return get_whole(component, vr, n, values, INTEGER, "fmi2GetInteger");
}

fmi2Status fmi2GetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2Boolean values[]) {
    return get_whole(component, vr, n, values, BOOLEAN, "fmi2GetBoolean");
}

static fmi2Status none_of_type(fmi2Component component, const fmi2ValueReference vr[], size_t n, const char *name,
                               int type) {
    ENTER(ANY_PHASE, name);
    WANT(!n || vr, "The value references are missing.");
    for (size_t k = 0; k < n; k++) {
        if (type >= 0 && (status = check_reference(c, vr[k], type)) != OK)
            return (fmi2Status)status;
        return (fmi2Status)refuse(c, ERROR, "%s: there is no such variable with the value reference %u.", name, vr[k]);
    }
    return fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, fmi2String values[]) {
    (void)values;
    return none_of_type(component, vr, n, "fmi2GetString", -1);
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Real values[]) {
    ENTER(ANY_PHASE & ~TERMINATED, "fmi2SetReal");
    WANT(!n || (vr && values), "The value references or values are missing.");
    return (fmi2Status)set_values(c, vr, values, n);
}

fmi2Status fmi2SetInteger(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Integer values[]) {
    (void)values;
    return none_of_type(component, vr, n, "fmi2SetInteger", INTEGER);
}

fmi2Status fmi2SetBoolean(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2Boolean values[]) {
    (void)values;
    return none_of_type(component, vr, n, "fmi2SetBoolean", BOOLEAN);
}

fmi2Status fmi2SetString(fmi2Component component, const fmi2ValueReference vr[], size_t n, const fmi2String values[]) {
    (void)values;
    return none_of_type(component, vr, n, "fmi2SetString", -1);
}

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *where) {
    ENTER(ANY_PHASE, "fmi2GetFMUstate");
    return (fmi2Status)save(c, where);
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate kept) {
    ENTER(ANY_PHASE, "fmi2SetFMUstate");
    return (fmi2Status)restore(c, kept);
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *where) {
    ENTER(ANY_PHASE, "fmi2FreeFMUstate");
    return (fmi2Status)forget(c, where);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate kept, size_t *size) {
    ENTER(ANY_PHASE, "fmi2SerializedFMUstateSize");
    return (fmi2Status)n_bytes(c, kept, size);
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate kept, fmi2Byte bytes[], size_t size) {
    ENTER(ANY_PHASE, "fmi2SerializeFMUstate");
    return (fmi2Status)write_bytes(c, kept, (unsigned char *)bytes, size);
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size, fmi2FMUstate *where) {
    ENTER(ANY_PHASE, "fmi2DeSerializeFMUstate");
    return (fmi2Status)read_bytes(c, (const unsigned char *)bytes, size, where);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | STEP_MODE | TERMINATED, "fmi2GetDirectionalDerivative");
    WANT((!n_unknowns || (unknowns && sensitivity)) && (!n_knowns || (knowns && seed)),
         "The references, seeds or sensitivities are missing.");
    return (fmi2Status)directional(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

#include "fmi2_model_exchange.c"
#include "fmi2_co_simulation.c"
