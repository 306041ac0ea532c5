/* A whole run over output times. */

/* Return the end of the piece from output time k on in which the inputs go on as they are. */
static long end_of_piece(long k, long n, const double *inputs, const char *jumps)
{
    const int n_u = (N_W - 1) / 2;
    const double *own = inputs + k * N_W;
    long end = k + 1;
    for (int i = n_u; i < 2 * n_u; i++)
        if (own[i] != 0) return end; /* inputs with a slope change from interval to interval */
    while (end < n - 1 && !jumps[end] && !memcmp(own, inputs + end * N_W, sizeof(double) * 2 * n_u)) end++;
    return end;
}

/* Give all variables at the output times, and the lowest and the largest magnitude of each indicator over them: what is
 * below zero was missed. */
static void look_back(engine *e, long n, const double *grid, const double *inputs, const double *ys, const double *ms,
                      double *variables, double *lowest, double *largest)
{
    double found[ROOM(N_V)], y[ROOM(N_X - N_SHADOW + N_Z)];
    for (int g = 0; g < N_G; g++) lowest[g] = 1, largest[g] = 0;
    for (long k = 0; k < n; k++) {
        memcpy(e->now.w, inputs + (k < n - 1 ? k : k - 1) * N_W, sizeof(double) * N_W);
        memcpy(e->now.m, ms + k * N_M, sizeof(double) * N_M);
        memcpy(y, ys + k * N_Y, sizeof(double) * (N_X - N_SHADOW));
        memcpy(y + N_X - N_SHADOW, ys + k * N_Y + N_X, sizeof(double) * N_Z);
        EVALUATE(model_outputs, given(arguments, &e->now, grid + k, y), results[0] = found, results[1] = e->found);
        for (int v = 0; v < N_V; v++) variables[v * n + k] = found[v];
        for (int g = 0; g < N_G; g++) {
            lowest[g] = fmin(lowest[g], e->found[g]);
            largest[g] = fmax(largest[g], fabs(e->found[g]));
        }
    }
}

/* Run from grid[0] to grid[n - 1].
 *
 * set: settings; start: y, m, p one after the other; inputs (n - 1, N_W); jumps (n - 1): whether an input jumps at the
 * begin of the interval. Fills ys (n, N_Y), ms (n, N_M) with what holds after a jump or an event, variables (N_V, n),
 * statistics (steps, rejected, trials, events, time reached), lowest and largest (N_G). A run that stops keeps its last
 * values. */
CASADI_SYMBOL_EXPORT int run_over_grid(const double *set, const double *start, long n, const double *grid,
                                       const double *inputs, const char *jumps, double *ys, double *ms,
                                       double *variables, double *statistics, double *lowest, double *largest)
{
    engine e;
    memset(&e, 0, sizeof e);
    e.set = (settings){set[0], set[1], set[2], set[3], set[4]};
    e.now.t = grid[0];
    memcpy(e.now.y, start, sizeof(double) * N_Y);
    memcpy(e.now.m, start + N_Y, sizeof(double) * N_M);
    memcpy(e.now.p, start + N_Y + N_M, sizeof(double) * N_P);
    memcpy(e.now.w, inputs, sizeof(double) * N_W);
    begin_run(&e);
    enum outcome outcome = DONE;
    long next = 0; /* the first output time that is not filled */
    for (long k = 0; k < n - 1 && outcome >= 0 && outcome != STOPPED;) {
        long end = end_of_piece(k, n, inputs, jumps);
        memcpy(e.now.w, inputs + k * N_W, sizeof(double) * N_W);
        e.is_stepped = 0;
        outcome = DONE;
        if (jumps[k]) {
            outcome = decide(&e);
            if (e.now.first_step > 0) e.now.step = e.now.first_step;
        }
        while (outcome >= 0 && outcome != STOPPED && e.now.t < grid[end] - closeness(grid[end])) {
            double from = e.now.t;
#if IS_LEAPING
            long later = next;
            while (later < n - 1 && grid[later] <= from + closeness(from)) later++;
            e.output_at = grid[later];
#endif
            outcome = e.now.n_steps + e.now.n_trials < e.set.most_steps ? advance(&e, grid[end]) : TOO_MANY;
            if (outcome < 0) break;
            for (; next < end && grid[next] < e.until && e.now.t > from; next++) {
                output(&e, fmax(grid[next] - e.t_0, 0) / e.h, ys + next * N_Y);
                memcpy(ms + next * N_M, e.m_0, sizeof(double) * N_M);
            }
        }
        k = end;
    }
    for (; outcome >= 0 && next < n; next++) {
        memcpy(ys + next * N_Y, e.now.y, sizeof(double) * N_Y);
        memcpy(ms + next * N_M, e.now.m, sizeof(double) * N_M);
    }
    statistics[0] = e.now.n_steps, statistics[1] = e.now.n_rejected, statistics[2] = e.now.n_trials;
    statistics[3] = e.now.n_events, statistics[4] = e.now.t;
    if (outcome >= 0) look_back(&e, n, grid, inputs, ys, ms, variables, lowest, largest);
    return outcome;
}
