/* The start: the square equations of the export, solved again by Newton's method for what the importer has set. */

static void evaluate_start(Instance *c, const double *point, double *residual, double *matrix) {
    State *s = &c->state;
    const casadi_real *in[] = {&s->time, point, s->u, s->m, s->p, s->starts, s->given};
    memcpy(c->arg, in, sizeof in);
    c->res[0] = residual;
    c->res[1] = matrix;
    fmu_start(c->arg, c->res, c->iw, c->w, 0);
}

/* Solve from the point v (N_V,) on, in place; a step is shortened until the next one, with the same slopes, is shorter
 * (Deuflhard, Newton Methods for Nonlinear Problems, 2004). Return whether it was solved. */
static int newton_start(Instance *c, double *v) {
    for (int round = 0; round < 100 && N_V > 0; round++) {
        evaluate_start(c, v, c->residual, c->matrix);
        if (!are_finite(c->residual, N_V) || !are_finite(c->matrix, (size_t)N_V * N_V) ||
            !lu_factor(c->matrix, c->pivots, N_V))
            return 0;
        memcpy(c->step, c->residual, N_V * sizeof(double));
        lu_solve(c->matrix, c->pivots, c->step, N_V);
        double size = norm(c->step, V_SCALE, v, N_V), part = 1;
        if (!isfinite(size))
            return 0;
        if (size < 1e-13) {
            for (int k = 0; k < N_V; k++)
                v[k] -= c->step[k];
            return 1;
        }
        for (;; part /= 2) {
            if (part < 1e-8)
                return size < 1e-9;          /* rounding: nothing makes it better */
            for (int k = 0; k < N_V; k++)
                c->trial[k] = v[k] - part * c->step[k];
            evaluate_start(c, c->trial, c->residual, NULL);
            if (!are_finite(c->residual, N_V))
                continue;
            lu_solve(c->matrix, c->pivots, c->residual, N_V);
            double next = norm(c->residual, V_SCALE, v, N_V);
            if (next <= (1 - part / 2) * size || next < 1e-13)
                break;
        }
        memcpy(v, c->trial, N_V * sizeof(double));
    }
    return N_V == 0;
}

/* Go from the parameters of the export to those of the importer in steps, each solved from the last. */
static int followed_start(Instance *c, double *v) {
#if N_P > 0
    State *s = &c->state;
    double wanted[N_P], done = 0, part = 0.25;
    memcpy(wanted, s->p, sizeof wanted);
    memcpy(v, V_START, N_V * sizeof(double));
    while (done < 1 && part > 1e-4) {
        double next = done + part > 1 ? 1 : done + part, trial[AT_LEAST_1(N_V)];
        for (int k = 0; k < N_P; k++)
            s->p[k] = P_START[k] + next * (wanted[k] - P_START[k]);
        memcpy(trial, v, sizeof(double) * N_V);
        if (newton_start(c, trial)) {
            memcpy(v, trial, sizeof(double) * N_V);
            done = next;
            part *= 2;
        } else {
            part /= 4;
        }
    }
    memcpy(s->p, wanted, sizeof wanted);
    return done >= 1;
#else
    (void)c, (void)v;
    return 0;
#endif
}

/* Take relations, modes and conditions from the states; return whether any of them is new. */
static int decided_anew(Instance *c) {
    int is_new = 0;
#if N_M > 0
    State *s = &c->state;
    double relations[AT_LEAST_1(N_RELATIONS)], speeds[AT_LEAST_1(N_MODES)], held[AT_LEAST_1(N_HELD)];
    give(c, &s->time);
    c->res[0] = relations;
    c->res[1] = speeds;
    c->res[2] = held;
    fmu_decide(c->arg, c->res, c->iw, c->w, 0);
    double *m = c->new_m;
    memcpy(m, s->m, sizeof s->m);
    for (int k = 0; k < N_MODES; k++)
        m[k] = speeds[k] > 1e-9 ? 1 : speeds[k] < -1e-9 ? -1 : 0;
    m += N_MODES + N_DISCRETES;
    memcpy(m, relations, N_RELATIONS * sizeof(double));
    memcpy(m + N_RELATIONS, held, N_HELD * sizeof(double));
    if (N_START_FORCES) {             /* what sticks or slides takes part in the start */
        double decided[AT_LEAST_1(N_M)];
        double moved[AT_LEAST_1(N_X)];
        memcpy(moved, s->x, sizeof moved);
        memcpy(decided, c->new_m, sizeof decided);
        settle(c, moved, decided);
        memcpy(c->new_m, decided, N_MODES * sizeof(double));
    }
    is_new = memcmp(c->new_m, s->m, sizeof s->m) != 0;
    memcpy(s->m, c->new_m, sizeof s->m);
#endif
    return is_new;
}

static int solve_start(Instance *c) {
    State *s = &c->state;
    double v[AT_LEAST_1(N_V)];
    if (s->is_started)
        return OK;
    changed(c);
    c->arg[0] = &s->time;
    c->arg[1] = s->p;
    c->res[0] = s->m;
    fmu_begin(c->arg, c->res, c->iw, c->w, 0);
    for (int k = 0; k < N_DISCRETES; k++)
        if (s->discretes_given[k])
            s->m[N_MODES + k] = s->discretes[k];
    memcpy(v, s->point, N_V * sizeof(double));
    for (int k = 0; k < N_X; k++)
        if (s->given[k])
            v[k] = s->starts[k];
    for (int round = 0; round < 20 + 2 * N_MODES; round++) {
        if (!newton_start(c, v) && !followed_start(c, v))
            return refuse(c, ERROR, "%s: no start at %.6g s fits the start values and parameters that were set.",
                          MODEL_NAME, s->time);
        memcpy(s->x, v, N_X * sizeof(double));
        memcpy(s->z, v + N_X, N_Z * sizeof(double));
        for (int k = 0; k < N_UNKNOWN; k++)
            s->p[UNKNOWN[k]] = v[N_V - N_UNKNOWN + k];
        if (!decided_anew(c)) {
            s->is_started = 1;
            return OK;
        }
    }
    return refuse(c, ERROR, "%s: no start fits the conditions of %s: each that is tried makes others true.", MODEL_NAME,
                  EVENT_PLACES[0]);
}
