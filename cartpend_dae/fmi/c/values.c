/* Variables by value reference: groups of them follow each other in the order time, parameters, values, rates, memory,
 * indicators. */

enum { FIXED = 0, TUNABLE = 1, CONSTANT = 2, GUESS = 3 };
enum { REAL = 0, INTEGER = 1, BOOLEAN = 2 };

static int type_of(unsigned reference) {
    if (reference < FIRST_MEMORY || reference >= FIRST_INDICATOR)
        return REAL;
    return MEMORY_IS_BOOLEAN[reference - FIRST_MEMORY] ? BOOLEAN : INTEGER;
}

static int check_reference(Instance *c, unsigned reference, int type) {
    static const char *const words[] = {"real", "integer", "boolean"};
    if (reference >= N_VARIABLES)
        return refuse(c, ERROR, "%s has no variable with the value reference %u; the largest is %d.", MODEL_NAME,
                      reference, N_VARIABLES - 1);
    if (type_of(reference) != type)
        return refuse(c, ERROR, "`%s` is no %s variable.", VARIABLE_NAME[reference], words[type]);
    return OK;
}

/* What must be computed before a variable can be read. */
static int prepare(Instance *c, unsigned reference) {
    State *s = &c->state;
    if (reference < FIRST_PARAMETER)
        return OK;
    int is_known = 0;                    /* without solving anything */
    if (reference < FIRST_VALUE) {
        is_known = P_KIND[reference - FIRST_PARAMETER] != GUESS;
    } else if (reference < FIRST_RATE) {
        int k = (int)(reference - FIRST_VALUE);
        is_known = INPUT_OF[k] >= 0 || (STATE_OF[k] >= 0 && s->given[STATE_OF[k]] && !s->is_started);
    }
    if (is_known)
        return OK;
    int status = solve_start(c);
    if (status != OK || reference < FIRST_VALUE)
        return status;
    if (reference < FIRST_RATE)
        return STATE_OF[reference - FIRST_VALUE] >= 0 ? OK : need_values(c);
    if (reference < FIRST_MEMORY)
        return need_rates(c);
    return reference < FIRST_INDICATOR ? OK : need_indicators(c);
}

static double value_of(const Instance *c, unsigned reference) {
    const State *s = &c->state;
    if (reference < FIRST_PARAMETER)
        return s->time;
    if (reference < FIRST_VALUE)
        return s->p[reference - FIRST_PARAMETER];
    if (reference < FIRST_RATE) {
        int k = (int)(reference - FIRST_VALUE);
        if (INPUT_OF[k] >= 0)
            return s->u[INPUT_OF[k]];
        if (STATE_OF[k] >= 0)
            return !s->is_started && s->given[STATE_OF[k]] ? s->starts[STATE_OF[k]] : s->x[STATE_OF[k]];
        return c->y[k];
    }
    if (reference < FIRST_MEMORY)
        return c->ode[reference - FIRST_RATE];
    if (reference < FIRST_INDICATOR)
        return floor(s->m[MEMORY_AT[reference - FIRST_MEMORY]] + 0.5);
    return c->indicators[reference - FIRST_INDICATOR];
}

static int get_value(Instance *c, unsigned reference, int type, double *value) {
    int status = check_reference(c, reference, type);
    if (status == OK)
        status = prepare(c, reference);
    if (status == OK)
        *value = value_of(c, reference);
    return status;
}

static int cannot_set(Instance *c, unsigned reference, const char *why) {
    return refuse(c, ERROR, "`%s` cannot be set: %s.", VARIABLE_NAME[reference], why);
}

/* Check that a value can be set now. */
static int check_set(Instance *c, unsigned reference, double value) {
    State *s = &c->state;
    int status = check_reference(c, reference, REAL), begins = s->phase & (INSTANTIATED | INITIALIZATION_MODE);
    if (status != OK)
        return status;
    if (!isfinite(value))
        return refuse(c, ERROR, "`%s` was set to %g: it must be a finite number.", VARIABLE_NAME[reference], value);
    if (reference >= FIRST_PARAMETER && reference < FIRST_VALUE) {
        unsigned k = reference - FIRST_PARAMETER;
        if (P_KIND[k] == CONSTANT)
            return cannot_set(c, reference, "it was 0 at export, so that the part it belongs to does not exist");
        if (value < P_LOW[k] || value > P_HIGH[k])
            return refuse(c, ERROR, "`%s` was set to %g, outside its bounds [%g, %g].", VARIABLE_NAME[reference], value,
                          P_LOW[k], P_HIGH[k]);
        if (!begins && (P_KIND[k] != TUNABLE || s->phase == CONTINUOUS_MODE))
            return cannot_set(c, reference, P_KIND[k] == TUNABLE ? "tunable parameters change at events only"
                                                                 : "it is fixed after the initialization");
        return OK;
    }
    if (reference >= FIRST_VALUE && reference < FIRST_RATE) {
        int k = (int)(reference - FIRST_VALUE);
        if (INPUT_OF[k] >= 0)
            return s->phase == TERMINATED ? cannot_set(c, reference, "the run has ended") : OK;
        if (STATE_OF[k] >= 0 && !s->is_cs && (s->phase & (EVENT_MODE | CONTINUOUS_MODE)))
            return OK;                   /* some importers set states one by one */
        if (ALGEBRAIC_OF[k] >= 0 || DISCRETE_OF[k] >= 0 || (STATE_OF[k] >= 0 && SETTABLE[STATE_OF[k]]))
            return begins ? OK : cannot_set(c, reference, "its start value belongs before the end of initialization");
        if (STATE_OF[k] >= 0)
            return cannot_set(c, reference, "the equations decide where it starts");
    }
    return cannot_set(c, reference, "the model computes it");
}

/* Set what was checked. */
static void set_value(Instance *c, unsigned reference, double value) {
    State *s = &c->state;
    int begins = s->phase & (INSTANTIATED | INITIALIZATION_MODE);
    if (reference < FIRST_VALUE) {
        int k = (int)(reference - FIRST_PARAMETER);
        s->p[k] = value;
        for (int j = 0; j < N_UNKNOWN; j++)
            if (UNKNOWN[j] == k)
                s->point[N_V - N_UNKNOWN + j] = value;
    } else {
        int k = (int)(reference - FIRST_VALUE);
        if (INPUT_OF[k] >= 0) {
            s->u[INPUT_OF[k]] = value;
            s->u_slopes[INPUT_OF[k]] = 0;
        } else if (ALGEBRAIC_OF[k] >= 0) {
            s->point[N_X + ALGEBRAIC_OF[k]] = value;
        } else if (DISCRETE_OF[k] >= 0) {
            s->discretes[DISCRETE_OF[k]] = value;
            s->discretes_given[DISCRETE_OF[k]] = 1;
        } else if (!begins) {
            s->x[STATE_OF[k]] = value;
        } else {
            s->starts[STATE_OF[k]] = value;
            s->given[STATE_OF[k]] = 1;
        }
    }
    if (begins)
        s->is_started = 0;
    s->is_touched = 1;
    changed(c);
}

static int set_values(Instance *c, const unsigned *references, const double *values, size_t n) {
    int status = OK;
    for (size_t k = 0; k < n && status == OK; k++)
        status = check_set(c, references[k], values[k]);
    for (size_t k = 0; k < n && status == OK; k++)
        set_value(c, references[k], values[k]);
    return status;
}

/* Bring an instance to its begin. */
static void reset(Instance *c) {
    State *s = &c->state;
    int is_cs = s->is_cs, event_mode = s->event_mode_used, early = s->early_return_allowed;
    memset(s, 0, sizeof *s);
    s->is_cs = is_cs;
    s->event_mode_used = event_mode;
    s->early_return_allowed = early;
    s->phase = INSTANTIATED;
    s->next_event = HUGE_VAL;
    s->tolerance = TOLERANCE;
    memcpy(s->p, P_START, N_P * sizeof(double));
    memcpy(s->u, U_START, N_U * sizeof(double));
    memcpy(s->point, V_START, N_V * sizeof(double));
    changed(c);
}

/* Make an instance; its handle, or NULL with a sentence. */
static void *new_instance(const Instance *like, const char *name, const char *token) {
    Instance *c = calloc(1, sizeof *c);
    if (!c)
        return NULL;
    *c = *like;
    c->object = INSTANCE;
    snprintf(c->name, sizeof c->name, "%s", name ? name : MODEL_NAME);
    void *handle = NULL;
    if (!token || strcmp(token, MODEL_TOKEN))
        refuse(c, ERROR, "The description belongs to another export of %s: its token is %s, not %s.", MODEL_NAME,
               token ? token : "missing", MODEL_TOKEN);
    else if (!(handle = handle_for(c)))
        refuse(c, ERROR, "%s: there are %d instances, and more cannot be.", MODEL_NAME, N_SLOTS);
    if (!handle) {
        free(c);
        return NULL;
    }
    reset(c);
    return handle;
}

/* Return the instance of a handle if a call is allowed where it stands. */
static Instance *allowed(void *handle, int phases, const char *call, int *status) {
    Instance *c = instance_of(handle);
    *status = OK;
    if (!c)
        *status = ERROR;
    else if (!(c->state.phase & phases))
        *status = refuse(c, ERROR, "%s is not allowed %s.", call,
                         c->state.phase == INSTANTIATED     ? "before the initialization"
                         : c->state.phase == INITIALIZATION_MODE ? "in initialization mode"
                         : c->state.phase == EVENT_MODE          ? "in event mode"
                         : c->state.phase == CONTINUOUS_MODE     ? "in continuous-time mode"
                         : c->state.phase == STEP_MODE           ? "between steps"
                                                            : "after the end of the run");
    return *status == OK ? c : NULL;
}
