/* An importer of FMI 2.0: host2 LIBRARY GUID N_VARIABLES N_STATES N_INDICATORS KINDS MODE
 *
 * KINDS is me, cs or both. MODE `run` runs as model exchange by Euler steps with events, and as co-simulation, reads
 * and writes every variable, saves, serialises and restores on the way, and prints how many variables took a value and
 * what all are after the steps of co-simulation; what follows it as NUMBER:VALUE are inputs. MODE `random N` makes N
 * random calls, in any order, with any arguments. MODE `sequences N` makes N sequences of up to 60 such calls, each
 * from its own random numbers with instances of its own, and frees all at its end. The variables' types are asked from
 * the FMU itself. */
#include "fmi2Functions.h"
#include "host.h"

#define FUNCTIONS(X)                                                                                                   \
    X(GetTypesPlatform) X(GetVersion) X(SetDebugLogging) X(Instantiate) X(FreeInstance) X(SetupExperiment)             \
    X(EnterInitializationMode) X(ExitInitializationMode) X(Terminate) X(Reset) X(GetReal) X(GetInteger) X(GetBoolean)  \
    X(GetString) X(SetReal) X(SetInteger) X(SetBoolean) X(SetString) X(GetFMUstate) X(SetFMUstate) X(FreeFMUstate)     \
    X(SerializedFMUstateSize) X(SerializeFMUstate) X(DeSerializeFMUstate) X(GetDirectionalDerivative)                  \
    X(EnterEventMode) X(NewDiscreteStates) X(EnterContinuousTimeMode) X(CompletedIntegratorStep) X(SetTime)            \
    X(SetContinuousStates) X(GetDerivatives) X(GetEventIndicators) X(GetContinuousStates)                              \
    X(GetNominalsOfContinuousStates) X(SetRealInputDerivatives) X(GetRealOutputDerivatives) X(DoStep) X(CancelStep)    \
    X(GetStatus) X(GetRealStatus) X(GetIntegerStatus) X(GetBooleanStatus) X(GetStringStatus)

#define DECLARE(name) static fmi2##name##TYPE *name;
FUNCTIONS(DECLARE)
#define LOAD(name) name = (fmi2##name##TYPE *)symbol("fmi2" #name);

static const char *guid, *kinds;
static unsigned n_variables;
static size_t n_x, n_i;

static void log_message(fmi2ComponentEnvironment environment, fmi2String instance, fmi2Status status,
                        fmi2String category, fmi2String message, ...) {
    (void)environment, (void)instance, (void)category, (void)message;
    if (status >= fmi2Discard)
        refusals++;
}

static const fmi2CallbackFunctions callbacks = {log_message, calloc, free, NULL, NULL};

static fmi2Component made(fmi2Type type) { return Instantiate("host", type, guid, NULL, &callbacks, fmi2False, fmi2False); }

/* Read every variable by its type; write every one that takes its own value. Return how many were written. */
static unsigned touch_all(fmi2Component c) {
    unsigned n_written = 0;
    for (fmi2ValueReference vr = 0; vr < n_variables; vr++) {
        double real = 0;
        int whole = 0;
        if (GetReal(c, &vr, 1, &real) == fmi2OK) {
            n_written += SetReal(c, &vr, 1, &real) == fmi2OK;
            CHECK(GetInteger(c, &vr, 1, &whole) == fmi2Error && GetBoolean(c, &vr, 1, &whole) == fmi2Error);
        } else {
            int is_whole = GetInteger(c, &vr, 1, &whole) == fmi2OK, is_boolean = GetBoolean(c, &vr, 1, &whole) == fmi2OK;
            CHECK(is_whole + is_boolean == 1);
            CHECK(SetInteger(c, &vr, 1, &whole) == fmi2Error && SetBoolean(c, &vr, 1, &whole) == fmi2Error);
        }
        CHECK(GetString(c, &vr, 1, (fmi2String *)&(const char *){NULL}) == fmi2Error);
    }
    fmi2ValueReference beyond = n_variables;
    double nothing = 0;
    CHECK(GetReal(c, &beyond, 1, &nothing) == fmi2Error && SetReal(c, &beyond, 1, &nothing) == fmi2Error);
    CHECK(GetReal(c, NULL, 1, &nothing) == fmi2Error && GetReal(c, NULL, 0, NULL) == fmi2OK);
    return n_written;
}

static void check_saved(fmi2Component c) {
    fmi2FMUstate kept = NULL, again = NULL, stale;
    size_t size = 0;
    CHECK(GetFMUstate(c, &kept) == fmi2OK && kept);
    CHECK(SerializedFMUstateSize(c, kept, &size) == fmi2OK && size);
    char *bytes = calloc(1, size);
    CHECK(SerializeFMUstate(c, kept, bytes, size - 1) == fmi2Error);
    CHECK(SerializeFMUstate(c, kept, bytes, size) == fmi2OK);
    CHECK(DeSerializeFMUstate(c, bytes, size - 1, &again) == fmi2Error);
    CHECK(DeSerializeFMUstate(c, bytes, size, &again) == fmi2OK && again);
    CHECK(SetFMUstate(c, again) == fmi2OK);
    bytes[8] ^= 1;
    CHECK(DeSerializeFMUstate(c, bytes, size, &stale) == fmi2Error);
    stale = kept;
    CHECK(FreeFMUstate(c, &kept) == fmi2OK && !kept && FreeFMUstate(c, &kept) == fmi2OK);
    CHECK(FreeFMUstate(c, &stale) == fmi2Error && SetFMUstate(c, stale) == fmi2Error);
    CHECK(FreeFMUstate(c, &again) == fmi2OK);
    free(bytes);
}

static char *none = NULL, **inputs = &none;

static void print_values(fmi2Component c) {
    double real = 0;
    for (fmi2ValueReference vr = 0; vr < n_variables; vr++)
        if (GetReal(c, &vr, 1, &real) == fmi2OK)
            printf("value %u %.17g\n", vr, real);
}

static void initialise(fmi2Component c) {
    CHECK(SetupExperiment(c, fmi2True, 1e-6, 0, fmi2True, 1) == fmi2OK);
    CHECK(EnterInitializationMode(c) == fmi2OK);
    printf("%u written\n", touch_all(c));
    for (char **given = inputs; *given; given++) {
        fmi2ValueReference vr = 0;
        double value = 0;
        CHECK(sscanf(*given, "%u:%lf", &vr, &value) == 2 && SetReal(c, &vr, 1, &value) == fmi2OK);
    }
    CHECK(ExitInitializationMode(c) == fmi2OK);
}

static void run_model_exchange(void) {
    fmi2Component c = made(fmi2ModelExchange);
    fmi2EventInfo info;
    double *x = calloc(n_x + 1, sizeof *x), *rates = calloc(n_x + 1, sizeof *x), time = 0, *nominals = calloc(n_x + 1, sizeof *x);
    double *before = calloc(n_i + 1, sizeof *x), *after = calloc(n_i + 1, sizeof *x);
    CHECK(c);
    CHECK(SetTime(c, 0) == fmi2Error && GetDerivatives(c, rates, n_x) == fmi2Error);
    CHECK(EnterContinuousTimeMode(c) == fmi2Error && DoStep(c, 0, 1, fmi2True) == fmi2Error);
    initialise(c);
    CHECK(NewDiscreteStates(c, &info) == fmi2OK && EnterContinuousTimeMode(c) == fmi2OK);
    CHECK(GetNominalsOfContinuousStates(c, nominals, n_x) == fmi2OK);
    CHECK(GetEventIndicators(c, before, n_i) == fmi2OK && GetContinuousStates(c, x, n_x) == fmi2OK);
    for (int step = 1; step <= 1000 && !info.terminateSimulation; step++) {
        fmi2Boolean enters, ends;
        CHECK(GetDerivatives(c, rates, n_x) == fmi2OK);
        for (size_t k = 0; k < n_x; k++)
            x[k] += 1e-5 * rates[k];
        time = 1e-5 * step;
        CHECK(SetTime(c, time) == fmi2OK && SetContinuousStates(c, x, n_x) == fmi2OK);
        CHECK(CompletedIntegratorStep(c, fmi2True, &enters, &ends) == fmi2OK);
        CHECK(GetEventIndicators(c, after, n_i) == fmi2OK);
        int is_event = info.nextEventTimeDefined && time >= info.nextEventTime;
        for (size_t k = 0; k < n_i; k++)
            is_event |= (before[k] > 0) != (after[k] > 0);
        if (is_event || step == 500) {
            CHECK(EnterEventMode(c) == fmi2OK);
            touch_all(c);
            CHECK(NewDiscreteStates(c, &info) == fmi2OK && EnterContinuousTimeMode(c) == fmi2OK);
            CHECK(GetContinuousStates(c, x, n_x) == fmi2OK && GetEventIndicators(c, after, n_i) == fmi2OK);
        }
        memcpy(before, after, n_i * sizeof *x);
    }
    check_saved(c);
    x[0] = NAN;
    if (n_x)
        CHECK(SetContinuousStates(c, x, n_x) == fmi2Error);
    CHECK(SetTime(c, NAN) == fmi2Error && SetContinuousStates(c, x, n_x + 1) == fmi2Error);
    CHECK(Terminate(c) == fmi2OK && Terminate(c) == fmi2Error);
    CHECK(Reset(c) == fmi2OK);
    initialise(c);
    FreeInstance(c);
    FreeInstance(c);
    CHECK(Reset(c) == fmi2Error && GetReal(c, NULL, 0, NULL) == fmi2Error);
    free(x), free(rates), free(nominals), free(before), free(after);
}

static void run_co_simulation(void) {
    fmi2Component c = made(fmi2CoSimulation);
    double time = 0, reached = -1;
    fmi2Boolean ended;
    CHECK(c);
    initialise(c);
    for (int step = 0; step < 20; step++) {
        CHECK(DoStep(c, time, 0.01, fmi2True) == fmi2OK);
        time += 0.01;
        if (step == 10) {
            touch_all(c);
            check_saved(c);
        }
    }
    print_values(c);
    CHECK(GetRealStatus(c, fmi2LastSuccessfulTime, &reached) == fmi2OK && fabs(reached - time) < 1e-12);
    CHECK(GetBooleanStatus(c, fmi2Terminated, &ended) == fmi2OK && !ended);
    CHECK(DoStep(c, time + 1, 0.01, fmi2True) == fmi2Error && DoStep(c, time, -1, fmi2True) == fmi2Error);
    CHECK(DoStep(c, time, NAN, fmi2True) == fmi2Error && CancelStep(c) == fmi2Error);
    CHECK(Terminate(c) == fmi2OK && DoStep(c, time, 0.01, fmi2True) == fmi2Error);
    FreeInstance(c);
}

#define MOST 4
static fmi2Component instances[MOST];
static fmi2FMUstate states[MOST];

/* Make one call with random arguments; handles may be freed, never made, or NULL. */
static void random_call(void) {
    fmi2Component c = instances[below(MOST)];
    fmi2FMUstate *state = &states[below(MOST)], copy = *state;
    fmi2ValueReference vr[3] = {below(n_variables + 3), below(n_variables + 3), below(n_variables)};
    double reals[3] = {number(), number(), number()}, out[3], *buffer = calloc(n_x + n_i + 4, sizeof(double));
    int wholes[3] = {0, 1, 2};
    const char *words[3] = {"logStatusError", "nonsense", NULL};
    size_t n = below(4), size;
    fmi2EventInfo info;
    fmi2Boolean a, b;
    fmi2Status status;
    char *bytes;
    switch (below(46)) {
    case 0: case 1:
        c = Instantiate("random", (fmi2Type)below(2), below(8) ? guid : "wrong", NULL, below(8) ? &callbacks : NULL, 0, below(2));
        if (c) {
            FreeInstance(instances[0]);
            instances[0] = instances[1], instances[1] = instances[2], instances[2] = instances[3], instances[3] = c;
        }
        break;
    case 2: if (!below(4)) FreeInstance(c); break;
    case 3: SetupExperiment(c, below(2), reals[0], reals[1], below(2), reals[2]); break;
    case 4: case 5: EnterInitializationMode(c); break;
    case 6: case 7: ExitInitializationMode(c); break;
    case 8: if (!below(6)) Terminate(c); break;
    case 9: if (!below(3)) Reset(c); break;
    case 10: case 11: GetReal(c, vr, n % 4 ? n % 4 : 1, out); break;
    case 12: GetInteger(c, vr, n ? 1 : 0, wholes); break;
    case 13: GetBoolean(c, vr, n ? 1 : 0, wholes); break;
    case 14: GetString(c, vr, n ? 1 : 0, words); break;
    case 15: case 16: case 17: SetReal(c, vr, n % 4 ? n % 4 : 1, reals); break;
    case 18: SetInteger(c, vr, 1, wholes); break;
    case 19: SetBoolean(c, vr, 1, wholes); break;
    case 20: SetString(c, vr, 1, words); break;
    case 21: case 22: GetFMUstate(c, state); break;
    case 23: case 24: SetFMUstate(c, *state); break;
    case 25: FreeFMUstate(c, below(2) ? state : &copy); break;
    case 26:
        if (SerializedFMUstateSize(c, *state, &size) == fmi2OK) {
            bytes = calloc(1, size);
            SerializeFMUstate(c, *state, bytes, size - below(2));
            if (below(2))
                bytes[below(100)] ^= 1;
            DeSerializeFMUstate(c, bytes, size - below(2) * below((unsigned)size), &copy);
            FreeFMUstate(c, &copy);
            free(bytes);
        }
        break;
    case 27: GetDirectionalDerivative(c, vr, 1, vr + 1, below(3), reals, out); break;
    case 28: case 29: EnterEventMode(c); break;
    case 30: case 31: NewDiscreteStates(c, below(20) ? &info : NULL); break;
    case 32: case 33: EnterContinuousTimeMode(c); break;
    case 34: CompletedIntegratorStep(c, 1, &a, &b); break;
    case 35: SetTime(c, reals[0]); break;
    case 36: SetContinuousStates(c, buffer, below(4) ? n_x : n); break;
    case 37: GetDerivatives(c, buffer, below(4) ? n_x : n_x + 1); break;
    case 38: GetEventIndicators(c, buffer, below(4) ? n_i : n_i + 1); break;
    case 39: GetContinuousStates(c, buffer, below(4) ? n_x : n_x + 1); break;
    case 40: GetNominalsOfContinuousStates(c, buffer, below(4) ? n_x : n_x + 1); break;
    case 41: SetRealInputDerivatives(c, vr, 1, wholes + below(2), reals); break;
    case 42: if (GetRealStatus(c, fmi2LastSuccessfulTime, out) == fmi2OK) DoStep(c, out[0], 1e-3 * (1 + n), 1); break;
    case 43: DoStep(c, reals[0], 1e-3 * reals[1], 1); break;
    case 44: GetStatus(c, fmi2DoStepStatus, &status); GetStringStatus(c, fmi2PendingStatus, words); CancelStep(c); break;
    case 45: SetDebugLogging(c, below(2), n % 3, words); GetBooleanStatus(c, (fmi2StatusKind)below(4), &a); break;
    }
    free(buffer);
    n_calls++;
}

/* Free what random calls left: states by an instance of this moment, for theirs may be gone. */
static void free_all(void) {
    fmi2Component last = made(strcmp(kinds, "cs") ? fmi2ModelExchange : fmi2CoSimulation);
    for (int j = 0; j < MOST; j++)
        FreeFMUstate(last, &states[j]);
    FreeInstance(last);
    for (int k = 0; k < MOST; k++)
        FreeInstance(instances[k]);
    memset(instances, 0, sizeof instances);
    memset(states, 0, sizeof states);
}

/* Make random calls from nothing, or from an instance that stands at an event, between events, or before a step. */
static void sequence(unsigned number_of_it) {
    fmi2EventInfo info;
    begin_numbers(number_of_it);
    unsigned begin = below(4), n = 1 + below(60);
    int is_cs = !strcmp(kinds, "cs") || (strcmp(kinds, "me") && begin == 3);
    if (begin) {
        fmi2Component c = instances[below(MOST)] = made(is_cs ? fmi2CoSimulation : fmi2ModelExchange);
        CHECK(SetupExperiment(c, fmi2True, 1e-6, 0, fmi2True, 1) == fmi2OK);
        CHECK(EnterInitializationMode(c) == fmi2OK && ExitInitializationMode(c) == fmi2OK);
        if (!is_cs && begin == 2)
            CHECK(NewDiscreteStates(c, &info) == fmi2OK && EnterContinuousTimeMode(c) == fmi2OK);
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
    guid = argv[2], kinds = argv[6];
    n_variables = (unsigned)atoi(argv[3]);
    n_x = (size_t)atoi(argv[4]);
    n_i = (size_t)atoi(argv[5]);
    CHECK(!strcmp(GetVersion(), "2.0") && !strcmp(GetTypesPlatform(), "default"));
    CHECK(!Instantiate("host", fmi2ModelExchange, "wrong", NULL, &callbacks, 0, 0));
    CHECK(!Instantiate("host", fmi2ModelExchange, NULL, NULL, &callbacks, 0, 0));
    if (!strcmp(argv[7], "run")) {
        inputs = argv + 8;
        if (strcmp(argv[6], "cs"))
            run_model_exchange();
        if (strcmp(argv[6], "me"))
            run_co_simulation();
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
