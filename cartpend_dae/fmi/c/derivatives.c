/* Partial derivatives in a direction, and their adjoint, through the algebraic equations. */

/* Return where a known stands among (time, x, u, p), -1 if it is none. */
static int known_at(unsigned reference) {
    if (reference < FIRST_PARAMETER)
        return 0;
    if (reference < FIRST_VALUE)
        return 1 + N_X + N_U + (int)(reference - FIRST_PARAMETER);
    if (reference < FIRST_RATE) {
        int k = (int)(reference - FIRST_VALUE);
        return STATE_OF[k] >= 0 ? 1 + STATE_OF[k] : INPUT_OF[k] >= 0 ? 1 + N_X + INPUT_OF[k] : -1;
    }
    return -1;
}

/* Return where the derivative of an unknown stands, NULL if it has none. */
static double *unknown_at(Instance *c, unsigned reference) {
    if (reference >= FIRST_VALUE && reference < FIRST_RATE)
        return &c->d_y[reference - FIRST_VALUE];
    if (reference >= FIRST_RATE && reference < FIRST_MEMORY)
        return &c->d_ode[reference - FIRST_RATE];
    if (reference >= FIRST_INDICATOR && reference < N_VARIABLES)
        return &c->d_i[reference - FIRST_INDICATOR];
    return NULL;
}

static int check_derivative(Instance *c, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                            size_t n_knowns, const double *seed, size_t n_seed) {
    for (size_t k = 0; k < n_unknowns; k++)
        if (!unknown_at(c, unknowns[k]))
            return refuse(c, ERROR, "The value reference %u is no unknown with derivatives.", unknowns[k]);
    for (size_t k = 0; k < n_knowns; k++)
        if (known_at(knowns[k]) < 0)
            return refuse(c, ERROR, "The value reference %u is no known: time, state, input or parameter.", knowns[k]);
    if (!are_finite(seed, n_seed))
        return refuse(c, ERROR, "A seed of a derivative is not finite.");
    int status = solve_start(c);
    return status == OK ? solve_algebraic(c) : status;
}

/* Factor d(alg)/dz at the state. */
static int factored(Instance *c) {
#if N_Z > 0
    evaluate(c, fmu_algebraic, c->residual, c->matrix);
    if (!are_finite(c->matrix, N_Z * N_Z) || !lu_factor(c->matrix, c->pivots, N_Z))
        return refuse(c, DISCARD, "%s: the algebraic equations are singular at %.6g s.", MODEL_NAME, c->state.time);
#else
    (void)c;
#endif
    return OK;
}

static void forward(Instance *c, double *d_alg) {
    give(c, &c->state.time);
    c->arg[6] = c->known;
    c->arg[7] = c->d_z;
    c->res[0] = c->d_ode;
    c->res[1] = d_alg;
    c->res[2] = c->d_y;
    c->res[3] = c->d_i;
    fmu_forward(c->arg, c->res, c->iw, c->w, 0);
}

static int directional(Instance *c, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns, size_t n_knowns,
                       const double *seed, double *sensitivity) {
    int status = check_derivative(c, unknowns, n_unknowns, knowns, n_knowns, seed, n_knowns);
    if (status == OK)
        status = factored(c);
    if (status != OK)
        return status;
    memset(c->known, 0, sizeof c->known);
    memset(c->d_z, 0, sizeof c->d_z);
    for (size_t k = 0; k < n_knowns; k++)
        c->known[known_at(knowns[k])] += seed[k];
    if (N_Z > 0) {
        forward(c, c->d_alg);
        lu_solve(c->matrix, c->pivots, c->d_alg, N_Z);
        for (int k = 0; k < N_Z; k++)
            c->d_z[k] = -c->d_alg[k];
    }
    forward(c, NULL);
    for (size_t k = 0; k < n_unknowns; k++)
        sensitivity[k] = *unknown_at(c, unknowns[k]);
    return OK;
}

static void backward(Instance *c, double *known, double *z) {
    give(c, &c->state.time);
    c->arg[6] = c->d_ode;
    c->arg[7] = c->d_alg;
    c->arg[8] = c->d_y;
    c->arg[9] = c->d_i;
    c->res[0] = known;
    c->res[1] = z;
    fmu_adjoint(c->arg, c->res, c->iw, c->w, 0);
}

static int adjoint(Instance *c, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns, size_t n_knowns,
                   const double *seed, double *sensitivity) {
    int status = check_derivative(c, unknowns, n_unknowns, knowns, n_knowns, seed, n_unknowns);
    if (status == OK)
        status = factored(c);
    if (status != OK)
        return status;
    memset(c->d_ode, 0, sizeof c->d_ode);
    memset(c->d_alg, 0, sizeof c->d_alg);
    memset(c->d_y, 0, sizeof c->d_y);
    memset(c->d_i, 0, sizeof c->d_i);
    for (size_t k = 0; k < n_unknowns; k++)
        *unknown_at(c, unknowns[k]) += seed[k];
    if (N_Z > 0) {
        backward(c, NULL, c->d_z);
        lu_solve_transposed(c->matrix, c->pivots, c->d_z, N_Z);
        for (int k = 0; k < N_Z; k++)
            c->d_alg[k] = -c->d_z[k];
    }
    backward(c, c->known, NULL);
    for (size_t k = 0; k < n_knowns; k++)
        sensitivity[k] = c->known[known_at(knowns[k])];
    return OK;
}
