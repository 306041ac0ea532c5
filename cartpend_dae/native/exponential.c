/* One step from a tick to the next tick or output time, through the transient that the tick starts.
 *
 * A held value that jumps starts a transient of what is fast, such as a current, and a step with error control has to
 * follow it. Here its linear part is exact: with L a Jacobian of the rates f, known from an earlier point, and D(s) =
 * f(t_0 + s h, y(s)) - f_0 - L (y(s) - y_0), variation of constants gives
 *
 *   y(s) = y_0 + s h phi_1(s h L) f_0 + h int_0^s exp((s - r) h L) D(r) dr,
 *
 * and D, which is small and slow, is a parabola through three nodes, found by iteration (exponential collocation: M.
 * Hochbruck, A. Ostermann, Exponential integrators, Acta Numerica 19 (2010), section 2.2). phi_k are the functions
 * phi_0(z) = exp(z), phi_k(z) = sum of z^j / (j + k)!; at twice their argument by 2^k phi_k(2 z) = phi_0 phi_k + sum_j
 * phi_j / (k - j)! (section 4.2 there).
 */

#if IS_LEAPING

static const double EX_C[N_NODES] = {0.25, 0.5, 1};
/* Lagrange's parabolas of the nodes by powers of s */
static const double EX_L[N_NODES][3] = {{8.0 / 3, -8, 16.0 / 3}, {-2, 10, -8}, {1.0 / 3, -2, 8.0 / 3}};
static const double EX_B[N_NODES] = {4.0 / 9, 1.0 / 3, 2.0 / 9}; /* their integrals */
/* Where D is smooth, the parabola misses its integral by this part of what it misses D(0) = 0 by (both are third
 * differences). A transient that is over before the first node, in a 20th of the step, is not seen at all: the integral
 * may miss a 20th of what it misses D(0) by, which is less, and half of a 20th squared of the slope of D. */
#define MISSED (1.0 / 6)
#define MISSED_SLOPE (0.5 / 400)
#define TERMS 12
/* costs in ordinary steps, measured: of a leap, and of new matrices */
#define COST_OF_LEAP 1.0
#define COST_OF_MATRICES 6.0
#define LONGEST_WAIT 64 /* ticks until another attempt, after some that did not pay */

/* Multiply two matrices (by columns) and add a multiple of one. */
static void multiply(const double *a, const double *b, double one, double *product)
{
    for (int c = 0; c < N_X; c++)
        for (int r = 0; r < N_X; r++) {
            double sum = r == c ? one : 0;
            for (int k = 0; k < N_X; k++) sum += a[k * N_X + r] * b[c * N_X + k];
            product[c * N_X + r] = sum;
        }
}

/* Multiply a matrix and a vector, and add that to another one. */
static void apply(const double *matrix, const double *vector, double *result)
{
    for (int r = 0; r < N_X; r++) {
        double sum = result[r];
        for (int c = 0; c < N_X; c++) sum += matrix[c * N_X + r] * vector[c];
        result[r] = sum;
    }
}

/* Give phi_0 to phi_3 of a small matrix. */
static void begin_phi(const double *z, double phi[4][N_X * N_X])
{
    double divisor = 6, sum[N_X * N_X] = {0};
    for (int k = 4; k <= TERMS + 3; k++) divisor *= k;
    for (int k = TERMS; k >= 0; k--) {
        multiply(z, sum, 1 / divisor, phi[3]);
        memcpy(sum, phi[3], sizeof sum);
        divisor /= k + 3;
    }
    multiply(z, phi[3], 0.5, phi[2]);
    multiply(z, phi[2], 1, phi[1]);
    multiply(z, phi[1], 1, phi[0]);
}

/* Give phi_0 to phi_3 of twice a matrix. */
static void double_phi(double phi[4][N_X * N_X])
{
    double product[4][N_X * N_X];
    for (int k = 0; k < 4; k++) multiply(phi[0], phi[k], 0, product[k]);
    for (int i = 0; i < N_X * N_X; i++) {
        phi[3][i] = (product[3][i] + phi[1][i] / 2 + phi[2][i] + phi[3][i]) / 8;
        phi[2][i] = (product[2][i] + phi[1][i] + phi[2][i]) / 4;
        phi[1][i] = (product[1][i] + phi[1][i]) / 2;
        phi[0][i] = product[0][i];
    }
}

/* Make the matrices of a step of length h. */
static void make_propagator(const double *linear, double h, propagator *made)
{
    double z[N_X * N_X], phi[4][N_X * N_X], norm = 0;
    int halvings = 0;
    for (int c = 0; c < N_X; c++) {
        double sum = 0;
        for (int r = 0; r < N_X; r++) sum += fabs(linear[c * N_X + r]);
        norm = fmax(norm, sum * EX_C[0] * h);
    }
    for (; norm > 0.5 && halvings < 60; halvings++) norm /= 2;
    for (int i = 0; i < N_X * N_X; i++) z[i] = ldexp(linear[i] * EX_C[0] * h, -halvings);
    begin_phi(z, phi);
    for (; halvings > 0; halvings--) double_phi(phi);
    for (int node = 0; node < N_NODES; node++) {
        double c = EX_C[node];
        for (int i = 0; i < N_X * N_X; i++) {
            made->free[node][i] = c * h * phi[1][i];
            for (int j = 0; j < N_NODES; j++)
                made->driven[node][j][i] = h * c * (EX_L[j][0] * phi[1][i] + EX_L[j][1] * c * phi[2][i]
                                                    + 2 * EX_L[j][2] * c * c * phi[3][i]);
        }
        if (node < N_NODES - 1) double_phi(phi);
    }
    for (int i = 0; i < N_X * N_X; i++) {
        made->decay[i] = phi[0][i];
        made->unseen[i] = h * h * phi[2][i];
        for (int j = 0; j < N_NODES; j++) made->unseen[i] -= h * EX_B[j] * made->free[j][i];
    }
    made->h = h;
}

/* Return the matrices of a step of length h, kept or made anew: what they are follows from where the run stands alone. */
static const propagator *propagator_of(engine *e, double h)
{
    leaper *l = &e->now.leaper;
    int n = (int)l->n_widths, place = 0;
    while (place < n && fabs(l->widths[place] - h) > 1e-11 * h) place++;
    if (place == n) {
        if (n < N_KEPT)
            l->n_widths++;
        else
            place = (int)l->oldest, l->oldest = (place + 1) % N_KEPT;
        l->widths[place] = h;
        l->cost += COST_OF_MATRICES;
    }
    if (memcmp(e->kept_of, l->linear, sizeof l->linear)) {
        memcpy(e->kept_of, l->linear, sizeof l->linear);
        for (int i = 0; i < N_KEPT; i++) e->kept[i].h = 0;
    }
    if (e->kept[place].h != l->widths[place]) make_propagator(l->linear, l->widths[place], e->kept + place);
    return e->kept + place;
}

/* Return the norm of a change over the tolerance. */
static double weighed_leap(const engine *e, const double *change, const double *end)
{
    double sum = 0;
    for (int r = 0; r < N_X; r++) {
        double weight = e->set.atol + e->set.rtol * fmax(fabs(e->y_0[r]), fabs(end[r]));
        sum += change[r] * change[r] / (weight * weight);
    }
    return sqrt(sum / N_X);
}

/* Give D at the nodes, where the states have changed by `change`, and the states there. */
static void differences(engine *e, const propagator *p, const double *f_0, double change[N_NODES][N_X],
                        double y[N_NODES][N_X], double d[N_NODES][N_X])
{
    for (int i = 0; i < N_NODES; i++) {
        double expected[N_X];
        memcpy(expected, f_0, sizeof expected);
        apply(e->now.leaper.linear, change[i], expected);
        for (int r = 0; r < N_X; r++) y[i][r] = e->y_0[r] + change[i][r];
        rates_at(&e->now, e->t_0 + EX_C[i] * p->h, y[i], d[i]);
        for (int r = 0; r < N_X; r++) d[i][r] -= expected[r];
    }
}

/* Give what the end of a step gets from what the nodes do not see of `stale` times the changes of the states. */
static void from_unseen(const propagator *p, const double *stale, const double *f_0, double *result)
{
    double unseen[N_X] = {0}, missed[N_X] = {0};
    apply(p->unseen, f_0, unseen);
    apply(stale, unseen, missed);
    memset(result, 0, sizeof unseen);
    apply(p->decay, missed, result);
}

/* Return how wrong the parabolas may be, over the tolerance, where D is `d` and the states change by `change`. */
static double missed_by(const engine *e, const propagator *p, const double *stale, double change[N_NODES][N_X],
                        double d[N_NODES][N_X], const double *end)
{
    double begin[N_X] = {0}, slope[N_X] = {0}, known[2][N_X], missed[N_X], error[N_X] = {0};
    memset(known, 0, sizeof known);
    for (int i = 0; i < N_NODES; i++)
        for (int r = 0; r < N_X; r++) begin[r] -= EX_L[i][0] * change[i][r], slope[r] -= EX_L[i][1] * change[i][r];
    apply(stale, begin, known[0]);
    apply(stale, slope, known[1]);
    for (int r = 0; r < N_X; r++) {
        for (int i = 0; i < N_NODES; i++) known[0][r] += EX_L[i][0] * d[i][r], known[1][r] += EX_L[i][1] * d[i][r];
        /* what depends on time alone is no transient */
        missed[r] = MISSED * fabs(known[0][r]) + MISSED_SLOPE * fabs(known[1][r] - p->h * e->in_time[r]);
    }
    apply(p->free[N_NODES - 1], missed, error);
    return weighed_leap(e, error, end);
}

/* Give the states at the nodes of a step; return by how much it may be wrong, over the tolerance.
 *
 * stale: what L lacks of the Jacobian at the begin of the step. */
static double propagated(engine *e, const propagator *p, const double *stale, const double *f_0,
                         double y[N_NODES][N_X])
{
    const int last = N_NODES - 1;
    double change[N_NODES][N_X], old[N_NODES][N_X], d[N_NODES][N_X], end[N_X], by[2][N_X], more[N_X];
    from_unseen(p, stale, f_0, more);
    memset(change, 0, sizeof change);
    for (int i = 0; i < N_NODES; i++) apply(p->free[i], f_0, change[i]);
    for (int sweep = 0; sweep < 2; sweep++) {
        differences(e, p, f_0, change, y, d);
        memcpy(old, change, sizeof old);
        memset(change, 0, sizeof change);
        for (int i = sweep == 0 ? 0 : last; i < N_NODES; i++) {
            apply(p->free[i], f_0, change[i]);
            for (int j = 0; j < N_NODES; j++) apply(p->driven[i][j], d[j], change[i]);
        }
        for (int r = 0; r < N_X; r++) {
            change[last][r] += more[r];
            end[r] = e->y_0[r] + change[last][r];
            by[sweep][r] = end[r] - y[last][r];
        }
    }
    double first = weighed_leap(e, by[0], end), second = weighed_leap(e, by[1], end);
    memcpy(y[last], end, sizeof end);
    /* the iteration goes on to fall as it fell */
    return missed_by(e, p, stale, old, d, end) + (second > 0 ? second * fmin(second / first, 1) : 0);
}

/* Return whether a leap to `end` on the way to a target may cost less than ordinary steps do. */
static int is_worth_a_leap(const engine *e, double end, double target)
{
    const leaper *l = &e->now.leaper;
    double h = end - e->now.t, parts = ceil((target - e->now.t) / h - 1e-6);
    if (l->wait > 0 || !(e->now.has_jumped || l->is_leaping)) return 0;
    return h > 1e-9 * fmax(1, fabs(end)) && 1.5 * COST_OF_LEAP * parts <= l->usual;
}

/* Wait the longer for the next attempt, the more often attempts have cost more than they saved. */
static void settle_leap(leaper *l, double saved)
{
    l->last_wait = saved > l->cost ? 0 : fmin(2 * l->last_wait + 1, LONGEST_WAIT);
    l->wait = l->last_wait;
    l->cost = 0;
}

/* Step to `target`, or to the next output time before it; return whether that was right and met no event. */
static int leapt(engine *e, double target)
{
    leaper *l = &e->now.leaper;
    double end = fmin(target, e->output_at), f_0[N_X], y[N_NODES][N_X], stale[N_X * N_X];
    double parts = ceil((end - e->now.t) / e->set.longest * (1 - 1e-9));
    if (parts > 1) end = e->now.t + (end - e->now.t) / parts;
    if (!is_worth_a_leap(e, end, target)) return 0;
    double h = end - e->now.t;
    e->t_0 = e->now.t, e->h = h;
    memcpy(e->y_0, e->now.y, sizeof e->y_0);
    rates_at(&e->now, e->t_0, e->y_0, f_0);
    int is_fresh = 0, is_right = 0;
    slopes_at(&e->now, e->t_0, e->y_0, e->jacobian, e->in_time);
    for (; !is_right && !is_fresh;) {
        if (!l->is_known) {
            memcpy(l->linear, e->jacobian, sizeof l->linear);
            l->is_known = is_fresh = 1, l->n_widths = l->oldest = 0;
        }
        for (int i = 0; i < N_X * N_X; i++) stale[i] = e->jacobian[i] - l->linear[i];
        is_right = propagated(e, propagator_of(e, h), stale, f_0, y) <= 1;
        l->cost += COST_OF_LEAP;
        if (!is_right) l->is_known = 0;
    }
    is_right = is_right && (!N_G || (least(e, e->t_0 + h / 2, y[1]) >= 0 && least(e, end, y[N_NODES - 1]) >= 0));
    settle_leap(l, is_right ? l->usual * h / l->between : 0);
    l->is_leaping = is_right;
    if (!is_right) return 0;
    memcpy(e->y_1, y[N_NODES - 1], sizeof e->y_1);
    memset(e->dense, 0, sizeof e->dense); /* outputs are at its ends only */
    for (int r = 0; r < N_X; r++) e->dense[0][r] = e->y_1[r] - e->y_0[r];
    e->is_rough = 0, e->is_stepped = 0;
    e->is_cut = end == target;
    e->now.has_jumped = 0, e->now.n_steps++;
    l->has_leapt = 1;
    return 1;
}

/* Learn at a tick how many ordinary steps lie between two. */
static void learn(engine *e)
{
    leaper *l = &e->now.leaper;
    if (!l->has_leapt) l->usual = e->now.n_steps - l->steps_before, l->between = fmax(e->now.t - l->tick_before, 1e-300);
    l->steps_before = e->now.n_steps, l->tick_before = e->now.t;
    l->has_leapt = l->is_leaping = 0;
    if (l->wait > 0) l->wait--;
}

#endif
