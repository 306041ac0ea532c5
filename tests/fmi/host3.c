/* An importer of FMI 3.0: host3 LIBRARY TOKEN N_VARIABLES N_STATES N_INDICATORS KINDS MODE
 *
 * KINDS is me, cs or both. MODE `run` runs as model exchange by Euler steps with events, and as co-simulation with and
 * without event mode, early return and intermediate update; reads and writes every variable, saves, serialises and
 * restores on the way, and prints how many variables took a value and what all are after the steps of each
 * co-simulation; what follows it as NUMBER:VALUE are inputs. MODE `random N` makes N random calls, in any order, with
 * any arguments; MODE `sequences N` makes N sequences of up to 60 such calls, each from its own random numbers with
 * instances of its own, and frees all at its end. */
#include <stdbool.h>

#include "fmi3Functions.h"
#include "host.h"

#define TYPES(X) X(Float32) X(Int8) X(UInt8) X(Int16) X(UInt16) X(UInt32) X(Int64) X(UInt64) X(String)
#define FUNCTIONS(X)                                                                                                   \
    X(GetVersion) X(SetDebugLogging) X(InstantiateModelExchange) X(InstantiateCoSimulation)                            \
    X(InstantiateScheduledExecution) X(FreeInstance) X(EnterInitializationMode) X(ExitInitializationMode)              \
    X(EnterEventMode) X(Terminate) X(Reset) X(GetFloat32) X(GetFloat64) X(GetInt8) X(GetUInt8) X(GetInt16)             \
    X(GetUInt16) X(GetInt32) X(GetUInt32) X(GetInt64) X(GetUInt64) X(GetBoolean) X(GetString) X(GetBinary) X(GetClock) \
    X(SetFloat32) X(SetFloat64) X(SetInt8) X(SetUInt8) X(SetInt16) X(SetUInt16) X(SetInt32) X(SetUInt32) X(SetInt64)   \
    X(SetUInt64) X(SetBoolean) X(SetString) X(SetBinary) X(SetClock) X(GetNumberOfVariableDependencies)                \
    X(GetVariableDependencies) X(GetFMUState) X(SetFMUState) X(FreeFMUState) X(SerializedFMUStateSize)                 \
    X(SerializeFMUState) X(DeserializeFMUState) X(GetDirectionalDerivative) X(GetAdjointDerivative)                    \
    X(EnterConfigurationMode) X(ExitConfigurationMode) X(GetIntervalDecimal) X(GetIntervalFraction)                    \
    X(GetShiftDecimal) X(GetShiftFraction) X(SetIntervalDecimal) X(SetIntervalFraction) X(SetShiftDecimal)             \
    X(SetShiftFraction) X(EvaluateDiscreteStates) X(UpdateDiscreteStates) X(EnterContinuousTimeMode)                   \
    X(CompletedIntegratorStep) X(SetTime) X(SetContinuousStates) X(GetContinuousStateDerivatives)                      \
    X(GetEventIndicators) X(GetContinuousStates) X(GetNominalsOfContinuousStates) X(GetNumberOfEventIndicators)        \
    X(GetNumberOfContinuousStates) X(EnterStepMode) X(GetOutputDerivatives) X(DoStep) X(ActivateModelPartition)

#define DECLARE(name) static fmi3##name##TYPE *name;
FUNCTIONS(DECLARE)
#define LOAD(name) name = (fmi3##name##TYPE *)symbol("fmi3" #name);

static const char *token, *kinds;
static unsigned n_variables, n_updates;
static size_t n_x, n_i;
static int returns_early;

static void log_message(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
    (void)environment, (void)category, (void)message;
    if (status >= fmi3Discard)
        refusals++;
}

static void updated(fmi3InstanceEnvironment environment, fmi3Float64 time, fmi3Boolean sets, fmi3Boolean gets,
                    fmi3Boolean finished, fmi3Boolean can_return, fmi3Boolean *requested, fmi3Float64 *wanted) {
    (void)environment, (void)sets, (void)gets, (void)finished;
    n_updates++;
    *requested = returns_early && can_return;
    *wanted = time;
}

static fmi3Instance exchange(const char *with) {
    return InstantiateModelExchange("host", with, NULL, false, false, NULL, log_message);
}

static fmi3Instance simulation(const char *with, bool event_mode, bool early, fmi3IntermediateUpdateCallback update) {
    return InstantiateCoSimulation("host", with, NULL, false, false, event_mode, early, NULL, 0, NULL, log_message, update);
}

static fmi3Status update(fmi3Instance c, bool *ends, bool *has_next, double *next) {
    bool again, nominals, values;
    fmi3Status status = UpdateDiscreteStates(c, &again, ends, &nominals, &values, has_next, next);
    CHECK(status != fmi3OK || !again);
    return status;
}

/* Read every variable by its type; write every one that takes its own value. */
static unsigned touch_all(fmi3Instance c) {
    unsigned n_written = 0;
    for (fmi3ValueReference vr = 0; vr < n_variables; vr++) {
        double real = 0;
        int32_t whole = 0;
        bool truth = false;
        int is_real = GetFloat64(c, &vr, 1, &real, 1) == fmi3OK, is_whole = GetInt32(c, &vr, 1, &whole, 1) == fmi3OK;
        int is_boolean = GetBoolean(c, &vr, 1, &truth, 1) == fmi3OK;
        CHECK(is_real + is_whole + is_boolean == 1);
        if (is_real)
            n_written += SetFloat64(c, &vr, 1, &real, 1) == fmi3OK;
        CHECK(SetInt32(c, &vr, 1, &whole, 1) == fmi3Error && SetBoolean(c, &vr, 1, &truth, 1) == fmi3Error);
        CHECK(GetFloat64(c, &vr, 1, &real, 2) == fmi3Error);
#define REFUSED(type)                                                                                                  \
    {                                                                                                                  \
        fmi3##type value = 0;                                                                                          \
        CHECK(Get##type(c, &vr, 1, &value, 1) == fmi3Error && Set##type(c, &vr, 1, &value, 1) == fmi3Error);           \
        CHECK(Get##type(c, NULL, 0, NULL, 0) == fmi3OK && Set##type(c, NULL, 0, NULL, 0) == fmi3OK);                   \
    }
        TYPES(REFUSED)
        CHECK(GetBinary(c, &vr, 1, NULL, NULL, 1) == fmi3Error && SetBinary(c, &vr, 1, NULL, NULL, 1) == fmi3Error);
        CHECK(GetClock(c, &vr, 1, NULL) == fmi3Error && SetClock(c, &vr, 1, NULL) == fmi3Error);
        CHECK(GetNumberOfVariableDependencies(c, vr, NULL) == fmi3Error);
        CHECK(GetVariableDependencies(c, vr, NULL, NULL, NULL, NULL, 0) == fmi3Error);
        CHECK(GetIntervalDecimal(c, &vr, 1, NULL, NULL) == fmi3Error && SetIntervalDecimal(c, &vr, 1, NULL) == fmi3Error);
        CHECK(GetIntervalFraction(c, &vr, 1, NULL, NULL, NULL) == fmi3Error);
        CHECK(SetIntervalFraction(c, &vr, 1, NULL, NULL) == fmi3Error);
        CHECK(GetShiftDecimal(c, &vr, 1, NULL) == fmi3Error && SetShiftDecimal(c, &vr, 1, NULL) == fmi3Error);
        CHECK(GetShiftFraction(c, &vr, 1, NULL, NULL) == fmi3Error && SetShiftFraction(c, &vr, 1, NULL, NULL) == fmi3Error);
        CHECK(GetOutputDerivatives(c, &vr, 1, NULL, NULL, 1) == fmi3Error);
        CHECK(ActivateModelPartition(c, vr, 0) == fmi3Error);
    }
    fmi3ValueReference beyond = n_variables;
    double nothing = 0;
    CHECK(GetFloat64(c, &beyond, 1, &nothing, 1) == fmi3Error && SetFloat64(c, &beyond, 1, &nothing, 1) == fmi3Error);
    CHECK(EnterConfigurationMode(c) == fmi3Error && ExitConfigurationMode(c) == fmi3Error);
    CHECK(EvaluateDiscreteStates(c) == fmi3Error);
    return n_written;
}

static void check_saved(fmi3Instance c) {
    fmi3FMUState kept = NULL, again = NULL, stale;
    size_t size = 0;
    CHECK(GetFMUState(c, &kept) == fmi3OK && SerializedFMUStateSize(c, kept, &size) == fmi3OK && size);
    uint8_t *bytes = calloc(1, size);
    CHECK(SerializeFMUState(c, kept, bytes, size - 1) == fmi3Error && SerializeFMUState(c, kept, bytes, size) == fmi3OK);
    CHECK(DeserializeFMUState(c, bytes, size - 1, &again) == fmi3Error);
    CHECK(DeserializeFMUState(c, bytes, size, &again) == fmi3OK && SetFMUState(c, again) == fmi3OK);
    stale = kept;
    CHECK(FreeFMUState(c, &kept) == fmi3OK && !kept && FreeFMUState(c, &kept) == fmi3OK);
    CHECK(FreeFMUState(c, &stale) == fmi3Error && SetFMUState(c, stale) == fmi3Error);
    CHECK(FreeFMUState(c, &again) == fmi3OK);
    free(bytes);
}

static char *none = NULL, **inputs = &none;

static void print_values(fmi3Instance c) {
    double real = 0;
    for (fmi3ValueReference vr = 0; vr < n_variables; vr++)
        if (GetFloat64(c, &vr, 1, &real, 1) == fmi3OK)
            printf("value %u %.17g\n", vr, real);
}

static void initialise(fmi3Instance c) {
    CHECK(EnterInitializationMode(c, true, 1e-6, 0, true, 1) == fmi3OK);
    printf("%u written\n", touch_all(c));
    for (char **given = inputs; *given; given++) {
        fmi3ValueReference vr = 0;
        double value = 0;
        CHECK(sscanf(*given, "%u:%lf", &vr, &value) == 2 && SetFloat64(c, &vr, 1, &value, 1) == fmi3OK);
    }
    CHECK(ExitInitializationMode(c) == fmi3OK);
}

static void run_model_exchange(void) {
    fmi3Instance c = exchange(token);
    bool ends, has_next, enters, stops;
    double next, *x = calloc(n_x + 1, sizeof *x), *rates = calloc(n_x + 1, sizeof *x), *nominals = calloc(n_x + 1, sizeof *x);
    double *before = calloc(n_i + 1, sizeof *x), *after = calloc(n_i + 1, sizeof *x);
    size_t n = 0;
    CHECK(c && GetNumberOfContinuousStates(c, &n) == fmi3OK && n == n_x);
    CHECK(GetNumberOfEventIndicators(c, &n) == fmi3OK && n == n_i);
    CHECK(SetTime(c, 0) == fmi3Error && GetContinuousStateDerivatives(c, rates, n_x) == fmi3Error);
    initialise(c);
    CHECK(update(c, &ends, &has_next, &next) == fmi3OK && EnterStepMode(c) == fmi3Error);
    CHECK(EnterContinuousTimeMode(c) == fmi3OK && GetNominalsOfContinuousStates(c, nominals, n_x) == fmi3OK);
    CHECK(GetEventIndicators(c, before, n_i) == fmi3OK && GetContinuousStates(c, x, n_x) == fmi3OK);
    for (int step = 1; step <= 1000 && !ends; step++) {
        CHECK(GetContinuousStateDerivatives(c, rates, n_x) == fmi3OK);
        for (size_t k = 0; k < n_x; k++)
            x[k] += 1e-5 * rates[k];
        CHECK(SetTime(c, 1e-5 * step) == fmi3OK && SetContinuousStates(c, x, n_x) == fmi3OK);
        CHECK(CompletedIntegratorStep(c, true, &enters, &stops) == fmi3OK);
        CHECK(GetEventIndicators(c, after, n_i) == fmi3OK);
        int is_event = has_next && 1e-5 * step >= next;
        for (size_t k = 0; k < n_i; k++)
            is_event |= (before[k] > 0) != (after[k] > 0);
        if (is_event || step == 500) {
            CHECK(EnterEventMode(c) == fmi3OK);
            touch_all(c);
            CHECK(update(c, &ends, &has_next, &next) == fmi3OK && EnterContinuousTimeMode(c) == fmi3OK);
            CHECK(GetContinuousStates(c, x, n_x) == fmi3OK && GetEventIndicators(c, after, n_i) == fmi3OK);
        }
        memcpy(before, after, n_i * sizeof *x);
    }
    check_saved(c);
    x[0] = NAN;
    if (n_x)
        CHECK(SetContinuousStates(c, x, n_x) == fmi3Error);
    CHECK(SetTime(c, NAN) == fmi3Error && SetContinuousStates(c, x, n_x + 1) == fmi3Error);
    CHECK(Terminate(c) == fmi3OK && Terminate(c) == fmi3Error && Reset(c) == fmi3OK);
    initialise(c);
    FreeInstance(c);
    FreeInstance(c);
    CHECK(Reset(c) == fmi3Error);
    free(x), free(rates), free(nominals), free(before), free(after);
}

static void run_co_simulation(bool event_mode, bool early, fmi3IntermediateUpdateCallback callback) {
    fmi3Instance c = simulation(token, event_mode, early, callback);
    double time = 0, next;
    bool ends = false, has_next, needs_event, is_early;
    CHECK(c);
    initialise(c);
    if (event_mode)
        CHECK(update(c, &ends, &has_next, &next) == fmi3OK && !has_next && EnterStepMode(c) == fmi3OK);
    for (int step = 0; step < 40 && !ends; step++) {
        double until = time + 0.01;
        CHECK(DoStep(c, time, 0.01, true, &needs_event, &ends, &is_early, &time) == fmi3OK);
        CHECK(is_early ? time < until && (event_mode || early) : fabs(time - until) < 1e-9);
        CHECK(!needs_event || event_mode);
        if (event_mode && (needs_event || step == 10)) {
            CHECK(EnterEventMode(c) == fmi3OK);
            touch_all(c);
            CHECK(update(c, &ends, &has_next, &next) == fmi3OK && EnterStepMode(c) == fmi3OK);
        }
        if (step == 10)
            check_saved(c);
    }
    print_values(c);
    CHECK(event_mode || EnterEventMode(c) == fmi3Error);
    CHECK(DoStep(c, time + 1, 0.01, true, &needs_event, &ends, &is_early, &next) == fmi3Error);
    CHECK(DoStep(c, time, -1, true, &needs_event, &ends, &is_early, &next) == fmi3Error);
    CHECK(SetTime(c, 1) == fmi3Error && Terminate(c) == fmi3OK);
    FreeInstance(c);
}

#define MOST 4
static fmi3Instance instances[MOST];
static fmi3FMUState states[MOST];

/* Make one call with random arguments; handles may be freed, never made, or NULL. */
static void random_call(void) {
    fmi3Instance c = instances[below(MOST)];
    fmi3FMUState *state = &states[below(MOST)], copy = *state;
    fmi3ValueReference vr[3] = {below(n_variables + 3), below(n_variables + 3), below(n_variables)};
    double reals[3] = {number(), number(), number()}, out[3], *buffer = calloc(n_x + n_i + 4, sizeof(double));
    int32_t wholes[3] = {0, 1, 2};
    bool truths[4], ends, has_next;
    const char *words[3] = {"logStatusError", "nonsense", NULL};
    size_t n = below(4), size;
    uint8_t *bytes;
    returns_early = below(2);
    switch (below(42)) {
    case 0: case 1:
        c = below(2) ? exchange(below(8) ? token : "wrong") : simulation(below(8) ? token : NULL, below(2), below(2), below(2) ? updated : NULL);
        if (c) {
            FreeInstance(instances[0]);
            instances[0] = instances[1], instances[1] = instances[2], instances[2] = instances[3], instances[3] = c;
        }
        break;
    case 2: if (!below(4)) FreeInstance(c); break;
    case 3: case 4: case 5: EnterInitializationMode(c, below(2), reals[0], below(4) ? 0 : reals[1], below(2), reals[2]); break;
    case 6: case 7: ExitInitializationMode(c); break;
    case 8: if (!below(6)) Terminate(c); break;
    case 9: if (!below(3)) Reset(c); break;
    case 10: case 11: GetFloat64(c, vr, n % 4 ? n % 4 : 1, out, n % 4 ? n % 4 : 1); break;
    case 12: GetInt32(c, vr, 1, wholes, 1); break;
    case 13: GetBoolean(c, vr, 1, truths, 1); break;
    case 14: GetString(c, vr, 1, words, 1); break;
    case 15: case 16: case 17: SetFloat64(c, vr, n % 4 ? n % 4 : 1, reals, n % 4 ? n % 4 : 1); break;
    case 18: SetInt32(c, vr, 1, wholes, 1); break;
    case 19: SetBoolean(c, vr, 1, truths, 1); break;
    case 20: SetString(c, vr, 1, words, 1); break;
    case 21: case 22: GetFMUState(c, state); break;
    case 23: case 24: SetFMUState(c, *state); break;
    case 25: FreeFMUState(c, below(2) ? state : &copy); break;
    case 26:
        if (SerializedFMUStateSize(c, *state, &size) == fmi3OK) {
            bytes = calloc(1, size);
            SerializeFMUState(c, *state, bytes, size - below(2));
            if (below(2))
                bytes[below(100)] ^= 1;
            DeserializeFMUState(c, bytes, size - below(2) * below((unsigned)size), &copy);
            FreeFMUState(c, &copy);
            free(bytes);
        }
        break;
    case 27: GetDirectionalDerivative(c, vr, 1, vr + 1, n % 3, reals, n % 3, out, 1); break;
    case 28: GetAdjointDerivative(c, vr, 1, vr + 1, n % 3, reals, 1, out, n % 3); break;
    case 29: case 30: EnterEventMode(c); break;
    case 31: case 32: update(c, &ends, &has_next, out); break;
    case 33: EnterContinuousTimeMode(c); break;
    case 34: EnterStepMode(c); CompletedIntegratorStep(c, true, truths, truths + 1); break;
    case 35: SetTime(c, reals[0]); break;
    case 36: SetContinuousStates(c, buffer, below(4) ? n_x : n); break;
    case 37: GetContinuousStateDerivatives(c, buffer, below(4) ? n_x : n_x + 1); break;
    case 38: GetEventIndicators(c, buffer, below(4) ? n_i : n_i + 1); break;
    case 39: GetContinuousStates(c, buffer, below(4) ? n_x : n_x + 1); break;
    case 40: {
        fmi3ValueReference time = 0;
        if (GetFloat64(c, &time, 1, out, 1) == fmi3OK)
            DoStep(c, out[0], 1e-3 * (1 + n), true, truths, truths + 1, truths + 2, out + 1);
        break;
    }
    case 41: DoStep(c, reals[0], 1e-3 * reals[1], true, truths, truths + 1, truths + 2, out); break;
    }
    free(buffer);
    n_calls++;
}

/* Free what random calls left: states by an instance of this moment, for theirs may be gone. */
static void free_all(void) {
    fmi3Instance last = strcmp(kinds, "cs") ? exchange(token) : simulation(token, false, false, NULL);
    for (int j = 0; j < MOST; j++)
        FreeFMUState(last, &states[j]);
    FreeInstance(last);
    for (int k = 0; k < MOST; k++)
        FreeInstance(instances[k]);
    memset(instances, 0, sizeof instances);
    memset(states, 0, sizeof states);
}

/* Make random calls from nothing, or from an instance that stands at an event, between events, or before a step. */
static void sequence(unsigned number_of_it) {
    double next;
    bool ends, has_next;
    begin_numbers(number_of_it);
    unsigned begin = below(4), n = 1 + below(60);
    int is_cs = !strcmp(kinds, "cs") || (strcmp(kinds, "me") && begin == 3);
    bool event_mode = below(2);
    if (begin) {
        fmi3Instance c = instances[below(MOST)] = is_cs ? simulation(token, event_mode, below(2), updated) : exchange(token);
        CHECK(EnterInitializationMode(c, true, 1e-6, 0, true, 1) == fmi3OK && ExitInitializationMode(c) == fmi3OK);
        if (!is_cs && begin == 2)
            CHECK(update(c, &ends, &has_next, &next) == fmi3OK && EnterContinuousTimeMode(c) == fmi3OK);
        if (is_cs && event_mode)
            CHECK(update(c, &ends, &has_next, &next) == fmi3OK && EnterStepMode(c) == fmi3OK);
    }
    for (unsigned k = 0; k < n; k++)
        random_call();
    free_all();
}

int main(int argc, char **argv) {
    if (argc < 8 || !(library = dlopen(argv[1], RTLD_NOW | RTLD_LOCAL))) {
        printf("%s\n", argc < 8 ? "too few arguments" : dlerror());
        return 2;
    }
    FUNCTIONS(LOAD)
    token = argv[2], kinds = argv[6];
    n_variables = (unsigned)atoi(argv[3]);
    n_x = (size_t)atoi(argv[4]);
    n_i = (size_t)atoi(argv[5]);
    CHECK(!strncmp(GetVersion(), "3.0", 3));
    CHECK(!exchange("wrong") && !exchange(NULL) && !simulation("wrong", false, false, NULL));
    CHECK(!InstantiateScheduledExecution("host", token, NULL, false, false, NULL, log_message, NULL, NULL, NULL));
    if (!strcmp(argv[7], "run")) {
        inputs = argv + 8;
        if (strcmp(argv[6], "cs"))
            run_model_exchange();
        for (int kind = 0; kind < 4 && strcmp(argv[6], "me"); kind++)
            run_co_simulation(kind & 1, kind & 2, kind & 2 ? updated : NULL);
        CHECK(n_updates > 0 || !strcmp(argv[6], "me"));
        returns_early = 1;
        if (strcmp(argv[6], "me"))
            run_co_simulation(false, true, updated);
    } else {
        int is_one = !strcmp(argv[7], "random");
        for (int k = 0; k < atoi(argv[8]); k++) {
            if (is_one)
                random_call();
            else
                sequence((unsigned)k);
        }
        free_all();
        CHECK(refusals > 0);
    }
    printf("%d calls, %d refusals, %d failures\n", n_calls, refusals, failures);
    return failures > 0;
}
