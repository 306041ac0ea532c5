/* Co-simulation: the engine of the package (engine.h) runs from one communication point to the next, through all events.
 *
 * Its `point` is part of the state of an instance: the states follow there with the shadows that keep steps short. */

/* Steps and trials in one communication step, after which something is wrong. */
#define MOST_ENGINE_STEPS 1e7

static void to_engine(Instance *c) {
    State *s = &c->state;
    engine *e = &c->engine;
    point *now = &s->now;
    now->t = s->time;
    memcpy(now->y, s->x, N_X * sizeof(double));
    memcpy(now->y + ENGINE_N_X, s->z, N_Z * sizeof(double));
    memcpy(now->m, s->m, N_M * sizeof(double));
    memcpy(now->p, s->p, N_P * sizeof(double));
    memset(now->w, 0, sizeof now->w);
    for (int k = 0; k < N_U; k++) {
        now->w[k] = s->u[k];
        now->w[N_U + k] = s->u_slopes[k];
    }
    now->w[2 * N_U] = s->time;
    e->set.rtol = s->tolerance;
    e->set.atol = 0.01 * s->tolerance;
    e->set.longest = LONGEST_STEP;
    e->set.most_steps = MOST_ENGINE_STEPS;
    e->set.method = METHOD;
    e->now = *now;
#if IS_LEAPING
    e->output_at = HUGE_VAL;
#endif
    e->is_stepped = 0;                   /* the next step begins anew, so that a saved state goes on alike */
}

/* Take over what the engine reached; `slopes` of inputs count since its begin at `from`. */
static void from_engine(Instance *c) {
    State *s = &c->state;
    engine *e = &c->engine;
    s->now = e->now;
    s->time = e->now.t;
    memcpy(s->x, e->now.y, N_X * sizeof(double));
    memcpy(s->z, e->now.y + ENGINE_N_X, N_Z * sizeof(double));
    memcpy(s->m, e->now.m, N_M * sizeof(double));
    changed(c);
}

/* Decide at the begin of a run, and make the engine ready. */
static int begin_steps(Instance *c) {
    int has_jumped, status = update_discrete(c, &has_jumped);
    if (status != OK || (status = solve_algebraic(c)) != OK)
        return status;
    memset(&c->state.now, 0, sizeof c->state.now);
    to_engine(c);
    begin_run(&c->engine);
    from_engine(c);
    return OK;
}

static int failed(Instance *c, int outcome) {
    static const char *const why[] = {"a derivative is not finite", "the step has become too small",
                                      "there are too many steps", "the algebraic equations have no solution"};
    return refuse(c, DISCARD, "%s: the step ends at %.9g s: %s.", MODEL_NAME, c->state.time, why[-1 - outcome]);
}

/* Run to a time. `at_event` is asked after each step whether to return there: it is told whether something was decided.
 * What was reached is kept also where a step fails. */
static int run_to(Instance *c, double until, int (*returns)(Instance *, int is_event)) {
    State *s = &c->state;
    engine *e = &c->engine;
    int outcome = DONE, status = solve_algebraic(c);
    double u_0[AT_LEAST_1(N_U)], begin = s->time, taken = 0;
    if (status != OK || s->is_terminated)
        return status;
    memcpy(u_0, s->u, N_U * sizeof(double));
    to_engine(c);
    if (s->is_touched) {                 /* what was set may have changed what is decided */
        s->is_touched = 0;
        e->now.has_jumped = 1;
        if (N_M > 0)
            outcome = decide(e);
        else
            arm(e);
        if (e->now.first_step > 0)
            e->now.step = e->now.first_step;
    }
    while (outcome >= 0 && outcome != STOPPED && e->now.t < until - closeness(until)) {
        outcome = taken++ < MOST_ENGINE_STEPS ? (int)advance(e, until) : TOO_MANY;
        if (outcome < 0 || !returns)
            continue;
        from_engine(c);
        for (int k = 0; k < N_U; k++)
            s->u[k] = u_0[k] + s->u_slopes[k] * (s->time - begin);
        if (returns(c, outcome == EVENT || outcome == STOPPED))
            break;
    }
    from_engine(c);
    for (int k = 0; k < N_U; k++) {
        s->u[k] = u_0[k] + s->u_slopes[k] * (s->time - begin);
        s->u_slopes[k] = 0;
    }
    if (outcome < 0)
        return failed(c, outcome);
    return told(c);
}
