/* The functions of the model at the state of an instance. */

enum { CHATTERING = -1, ZENO = -2 };

static void give(Instance *c, const double *time) {
    State *s = &c->state;
    c->arg[0] = time;
    c->arg[1] = s->x;
    c->arg[2] = s->m;
    c->arg[3] = s->z;
    c->arg[4] = s->u;
    c->arg[5] = s->p;
}

/* Evaluate a function of (t, x, m, z, u, p); results beyond the first two are not wanted. */
static int evaluate(Instance *c, Function f, double *first, double *second) {
    give(c, &c->state.time);
    c->res[0] = first;
    c->res[1] = second;
    return f(c->arg, c->res, c->iw, c->w, 0);
}

static double norm(const double *values, const double *scale, const double *point, int n) {
    double most = 0;
    for (int k = 0; k < n; k++) {
        double size = fabs(values[k]) / (fabs(point[k]) + (scale ? scale[k] : 1.0));
        if (!(size <= most))
            most = size;            /* also what is no number */
    }
    return most;
}

/* Solve for the algebraic variables by Newton's method from their last values. */
static int solve_algebraic(Instance *c) {
    State *s = &c->state;
    if (s->is_solved)
        return OK;
#if N_Z > 0
    const double *scale = V_SCALE + N_X;
    double kept[N_Z], last = HUGE_VAL;
    memcpy(kept, s->z, sizeof kept);
    for (int round = 0; round < 60; round++) {
        evaluate(c, fmu_algebraic, c->residual, c->matrix);
        if (!are_finite(c->residual, N_Z) || !are_finite(c->matrix, N_Z * N_Z) || !lu_factor(c->matrix, c->pivots, N_Z))
            break;
        lu_solve(c->matrix, c->pivots, c->residual, N_Z);
        double size = norm(c->residual, scale, s->z, N_Z);
        if (!isfinite(size))
            break;
        double part = size > 2 * last ? 0.25 : 1;       /* a step that grows is not trusted whole */
        for (int k = 0; k < N_Z; k++)
            s->z[k] -= part * c->residual[k];
        if (size < 1e-13 || (size < 1e-10 && size >= 0.5 * last)) {
            s->is_solved = 1;
            return OK;
        }
        last = size;
    }
    memcpy(s->z, kept, sizeof kept);
    return refuse(c, DISCARD, "%s: the algebraic equations have no solution near %.6g s that Newton's method finds.",
                  MODEL_NAME, s->time);
#else
    s->is_solved = 1;
    return OK;
#endif
}

static int need_rates(Instance *c) {
    int status = OK;
    if (c->has_ode)
        return OK;
    if ((status = solve_algebraic(c)) != OK)
        return status;
    evaluate(c, fmu_rates, c->ode, NULL);
    if (!are_finite(c->ode, N_X))
        return refuse(c, DISCARD, "%s: a derivative is not finite at %.6g s.", MODEL_NAME, c->state.time);
    c->has_ode = 1;
    return OK;
}

static int need_values(Instance *c) {
    int status = OK;
    if (c->has_y)
        return OK;
    if ((status = solve_algebraic(c)) != OK)
        return status;
    evaluate(c, fmu_outputs, c->y, NULL);
    c->has_y = 1;
    return OK;
}

static int need_indicators(Instance *c) {
    int status = OK;
    if (c->has_indicators)
        return OK;
    if ((status = solve_algebraic(c)) != OK)
        return status;
    evaluate(c, fmu_indicators, c->indicators, NULL);
    c->has_indicators = 1;
    return OK;
}

/* Decide by rounds until nothing changes: x and m are replaced. Memory that still changes is marked as chattering. */
static void settle(Instance *c, double *x, double *m) {
#if N_M > 0
    double next_x[AT_LEAST_1(N_X)], next_m[N_M], is_first = 1, has_changed = 1;
    for (int round = 0; has_changed != 0 && round < 1 + ROUNDS; round++, is_first = 0) {
        give(c, &c->state.time);
        c->arg[1] = x;
        c->arg[2] = m;
        c->arg[6] = &is_first;
        c->res[0] = next_x;
        c->res[1] = next_m;
        c->res[2] = &has_changed;
        fmu_round(c->arg, c->res, c->iw, c->w, 0);
        memcpy(x, next_x, N_X * sizeof(double));
        memcpy(m, next_m, sizeof next_m);
    }
    if (has_changed != 0 && m[N_M - N_NOTE] == 0) {
        m[N_M - N_NOTE] = CHATTERING;
        m[N_M - N_NOTE + 1] = c->state.time;
    }
#else
    (void)c, (void)x, (void)m;
#endif
}
