/* A run: steps as long as the error allows, to events, ticks and output times. */

#define SAFETY 0.9
#define SHRINK 0.2
#define GROW 5.0
#define SAME 1e-12 /* times so close, relative to them, are one */

static double closeness(double t) { return SAME * fmax(1, fabs(t)); }

/* Return a first step: 1 % of the time in which the states change by themselves (Hairer, Norsett, Wanner, II.4). */
static double first_step(engine *e)
{
    double rates[ROOM(N_Y)], size = 0, speed = 0;
    rates_at(&e->now, e->now.t, e->now.y, rates);
    for (int r = 0; r < N_X; r++) {
        double weight = e->set.atol + e->set.rtol * fabs(e->now.y[r]);
        size += e->now.y[r] * e->now.y[r] / (weight * weight), speed += rates[r] * rates[r] / (weight * weight);
    }
    double step = size < 1e-10 || speed < 1e-10 ? 1e-6 * e->set.longest : 0.01 * sqrt(size / speed);
    return fmin(step, e->set.longest);
}

/* Begin a run at a point; tolerances and start are there, and all else is made. */
static void begin_run(engine *e)
{
    point *now = &e->now;
    now->last_step = now->last_error = 0;
    now->first_step = now->n_steps = now->n_rejected = now->n_trials = now->n_events = 0;
    now->has_jumped = 0;
    e->is_stepped = 0;
    now->step = first_step(e);
    arm(e);
}

/* Return by how much longer the next step may be because errors fall from step to step, or shorter because they rise
 * (K. Gustafsson, ACM Trans. Math. Softw. 20 (1994)). */
static double foreseen(const point *now, double h, double error)
{
    return h / now->last_step * pow(now->last_error / fmax(error, 1e-4), 0.2);
}

/* Make one step that the error control takes, no further than `target`. */
static enum outcome take_step(engine *e, double target)
{
    point *now = &e->now;
    double rest = target - now->t, error;
    int is_rejected = 0;
    begin_step(e);
    for (;;) {
        double h = fmin(now->step, e->set.longest);
        int is_cut = h >= rest * (1 - 1e-10);
        e->is_cut = is_cut;
        if (is_cut)
            h = rest;
        else if (h > 0.5 * rest)
            h = 0.5 * rest; /* two equal steps instead of a long and a tiny one */
        try_step(e, h);
        error = weighed(e, e->error);
        double factor = isfinite(error) ? SAFETY * pow(fmax(error, 1e-10), -0.2) : SHRINK;
        if (error <= 1) {
            if (!now->has_jumped && !is_rejected && !is_cut && now->last_error > 0)
                factor *= foreseen(now, h, error);
            factor = fmin(fmax(factor, SHRINK), is_rejected ? 1 : GROW);
            if (now->has_jumped && !is_cut) now->first_step = h * factor;
            if (now->has_jumped || !is_cut || h * factor > now->step) now->step = h * factor;
            now->last_step = h, now->last_error = fmax(error, 1e-4);
            now->has_jumped = 0, now->n_steps++;
            return DONE;
        }
        is_rejected = 1, now->n_rejected++;
        now->step = h * fmin(fmax(factor, SHRINK), SAFETY);
        if (!(now->step > 16 * DBL_EPSILON * fabs(now->t)) || now->step < 1e-300)
            return isfinite(error) ? TOO_SMALL : NOT_FINITE;
    }
}

/* Make one step, no further than `target` or the first event in it. */
static enum outcome stepped(engine *e, double target, int *is_event)
{
#if IS_LEAPING
    if (leapt(e, target)) return DONE;
#endif
    enum outcome outcome = take_step(e, target);
    if (outcome != DONE) return outcome;
    e->is_stepped = 1;
    make_dense(e);
    if (N_G && shortened(e)) {
        make_dense(e);
        *is_event = 1;
    }
    return DONE;
}

/* Advance to an event, or `until`, by one step; EVENT if something was decided. */
static enum outcome advance(engine *e, double until)
{
    point *now = &e->now;
    double tick = next_tick(now);
    int is_tick = tick < until + closeness(until), is_event = 0;
    double target = is_tick ? tick : until;
    memcpy(e->m_0, now->m, sizeof now->m);
    if (is_tick && target - now->t <= closeness(target))
        now->t = fmax(now->t, target); /* the tick is now */
    else {
        enum outcome outcome = stepped(e, target, &is_event);
        if (outcome != DONE) return outcome;
        int is_reached = e->is_cut && !is_event;
        is_tick = is_tick && is_reached;
        now->t = is_reached ? target : e->t_0 + e->h;
        memcpy(now->y, e->y_1, sizeof now->y);
        if (N_G && !is_event) { /* what was below zero and has come up may fall again */
            for (int g = 0; g < N_G; g++)
                if (e->found[g] >= 0) now->armed[g] = 1;
        }
    }
    e->until = is_event ? now->t : now->t - closeness(now->t); /* a tick is where rounding puts it */
    if (!is_event && !is_tick) return DONE;
#if IS_LEAPING
    if (is_tick) learn(e);
#endif
    double before = now->step;
    enum outcome outcome = decide(e);
    now->step = now->first_step > 0 ? fmin(now->first_step, is_tick ? HUGE_VAL : before) : before;
    return outcome == DONE ? EVENT : outcome;
}
