/* Events: everything is decided again until nothing changes. */

/* Return how a run that the model stopped is told. */
static int told(Instance *c) {
#if N_M > 0
    State *s = &c->state;
    int reason = (int)floor(s->m[N_M - N_NOTE] + 0.5);
    if (reason > 0) {
        s->is_terminated = 1;
        refuse(c, WARNING, "%s ends at %.6g s by %s", MODEL_NAME, s->time, ACTION_SENTENCE[reason - 1]);
        return OK;
    }
    if (reason == CHATTERING)
        return refuse(c, ERROR, "%s: at %.6g s the decisions of %s go round in circles: each makes another one untrue.",
                      MODEL_NAME, s->time, EVENT_PLACES[0]);
    if (reason == ZENO)
        return refuse(c, ERROR, "%s: events of %s follow each other without end at %.6g s.", MODEL_NAME,
                      EVENT_PLACES[0], s->time);
#else
    (void)c;
#endif
    return OK;
}

/* Decide at an event; tell whether a state has jumped. An event of time that an importer meets a little early, within
 * the rounding of its own time, is decided at its own instant. */
static int update_discrete(Instance *c, int *has_jumped) {
    State *s = &c->state;
    int status = OK;
    *has_jumped = 0;
#if N_M > 0
    double kept = s->time;
    if (isfinite(s->next_event) && fabs(s->next_event - s->time) <= 1e-9 * (1 + fabs(s->time)) && s->time < s->next_event)
        s->time = s->next_event;
    for (int round = 0; round < 20 && status == OK; round++) {
        if ((status = solve_algebraic(c)) != OK)
            break;
        if (round == 0) {
            evaluate(c, fmu_rest, c->new_x, NULL);
            if (memcmp(c->new_x, s->x, N_X * sizeof(double))) {
                memcpy(s->x, c->new_x, N_X * sizeof(double));
                *has_jumped = 1;
                changed(c);
                if ((status = solve_algebraic(c)) != OK)
                    break;
            }
        }
        memcpy(c->new_x, s->x, sizeof s->x);
        memcpy(c->new_m, s->m, sizeof s->m);
        settle(c, c->new_x, c->new_m);
        if (!are_finite(c->new_x, N_X) || !are_finite(c->new_m, N_M)) {
            status = refuse(c, ERROR, "%s: what is decided at %.6g s is not finite.", MODEL_NAME, s->time);
            break;
        }
        int jumps = memcmp(c->new_x, s->x, N_X * sizeof(double)) != 0;
        int is_same = !jumps && !memcmp(c->new_m, s->m, (N_M - N_NOTE) * sizeof(double));
        *has_jumped |= jumps;
        memcpy(s->x, c->new_x, N_X * sizeof(double));
        memcpy(s->m, c->new_m, N_M * sizeof(double));
        if (is_same || N_Z == 0)
            break;
        changed(c);
    }
    evaluate(c, fmu_next_time, &s->next_event, NULL);
    s->time = kept;
    changed(c);
    if (status == OK)
        status = told(c);
#else
    s->next_event = HUGE_VAL;
#endif
    return status;
}
