/* Where an event is in a step, and what is decided there. */

#define SO_LITTLE 1e-7 /* of a step: what bends in it is below rounding */
#define INNER 2 /* so many points of a step are looked at for an event */

/* Return the least of the armed indicators at a point; 1 without any. */
static double least(engine *e, double t, const double *y)
{
    double low = 1;
    indicators_at(&e->now, t, y, e->found);
    for (int g = 0; g < N_G; g++)
        if (e->now.armed[g] && !(e->found[g] >= low)) low = e->found[g];
    return low;
}

static double least_inside(engine *e, double share)
{
    double y[ROOM(N_Y)];
    inside(e, share, y);
    return least(e, e->t_0 + share * e->h, y);
}

/* Step to h from the begin of the last step, and return the least of the armed indicators there. */
static double least_after(engine *e, double h)
{
    try_step(e, h);
    e->now.n_trials++;
    return least(e, e->t_0 + h, e->y_1);
}

/* A bracket of a fall through zero: `low` at or above zero at its begin, below zero at its end. */
typedef struct {
    double begin, end, at_begin, at_end;
} bracket;

/* Return where to look next: by the secant, which halves the value at the end that stays (Illinois), or the middle. */
static double between(const bracket *b, int trial)
{
    double middle = 0.5 * (b->begin + b->end);
    double secant = b->begin + (b->end - b->begin) * b->at_begin / (b->at_begin - b->at_end);
    return trial % 4 == 3 || !(secant > b->begin && secant < b->end) ? middle : secant;
}

static void narrow(bracket *b, double where, double value, int *side)
{
    if (value < 0) {
        b->end = where, b->at_end = value;
        if (*side < 0) b->at_begin *= 0.5;
        *side = -1;
    } else {
        b->begin = where, b->at_begin = value;
        if (*side > 0) b->at_end *= 0.5;
        *side = 1;
    }
}

/* Bracket the first fall through zero in the last step by its dense output; return whether there is one. */
static int bracketed(engine *e, bracket *b)
{
    *b = (bracket){0, 0, -1, 0};
    for (int i = 1; i <= INNER; i++) {
        double share = (double)i / INNER;
        double low = i < INNER ? least_inside(e, share) : least(e, e->t_0 + e->h, e->y_1);
        if (low < 0) {
            b->end = share, b->at_end = low;
            if (b->begin == 0) b->at_begin = fmax(least(e, e->t_0, e->y_0), 0);
            return 1;
        }
        b->begin = share, b->at_begin = low;
    }
    return 0;
}

/* Make the last step longer or shorter by so little that its end goes on as its rates say; return the least of the armed
 * indicators there. */
static double least_further(engine *e, double shift)
{
    double rates[ROOM(N_Y)];
    rates_at(&e->now, e->t_0 + e->h, e->y_1, rates);
    for (int r = 0; r < N_X; r++) e->y_1[r] += shift * rates[r];
    e->h += shift;
    return least(e, e->t_0 + e->h, e->y_1);
}

/* Step to where the dense output has its zero, and from there by its slope until just past the exact one; return whether
 * that succeeds: it does where the indicator is smooth. */
static int reached_by_slope(engine *e, double guess, double whole, double close)
{
    double reach = 1e-6, low = fmax(guess - reach, 0), high = fmin(guess + reach, 1);
    double slope = (least_inside(e, high) - least_inside(e, low)) / ((high - low) * whole), where = guess * whole;
    if (!(slope < 0)) return 0;
    for (int trial = 0; trial < 5 && where > 0 && where <= whole; trial++) {
        double value = least_after(e, where), shift = close - value / slope;
        if (value < 0 && value > 3 * close * slope) return 1;
        if (!N_Z && fabs(shift) < SO_LITTLE * where) {
            value = least_further(e, shift);
            if (value < 0 && value > 3 * close * slope) return 1;
        }
        where += shift;
    }
    return 0;
}

/* Close in on the first fall through zero by steps alone, slowly but surely; return whether there is one. */
static int reached_by_bracket(engine *e, double guess, double whole, double close)
{
    bracket b = {0, whole, fmax(least(e, e->t_0, e->y_0), 0), least_after(e, whole)};
    double inside = least_after(e, guess * whole);
    int side = 0;
    if (inside < 0)
        b.end = guess * whole, b.at_end = inside;
    else if (!(b.at_end < 0)) { /* the dense output alone falls below zero */
        try_step(e, whole);
        least(e, e->t_0 + whole, e->y_1);
        return 0;
    }
    for (int trial = 0; trial < 200 && b.end - b.begin > close; trial++) {
        double where = between(&b, trial);
        narrow(&b, where, least_after(e, where), &side);
    }
    if (e->h != b.end) try_step(e, b.end);
    return 1;
}

/* Shorten the last step to the first event in it, located as closely as time is told; return whether there is one. */
static int shortened(engine *e)
{
    bracket b;
    if (!bracketed(e, &b)) return 0;
    int side = 0;
    for (int trial = 0; trial < 60 && b.end - b.begin > 1e-9; trial++) {
        double share = between(&b, trial);
        narrow(&b, share, least_inside(e, share), &side);
    }
    double whole = e->h, guess = 0.5 * (b.begin + b.end), close = 4 * DBL_EPSILON * fmax(fabs(e->t_0), whole);
    return reached_by_slope(e, guess, whole, close) || reached_by_bracket(e, guess, whole, close);
}

/* Solve the algebraic equations where the run stands; return whether they have a solution. */
static int algebraics_solved(engine *e)
{
#if N_Z > 0
    double rates[N_Y], jacobian[N_Y * N_Y], in_time[N_Y], matrix[N_Z * N_Z];
    int pivots[N_Z];
    for (int trial = 0; trial < 50; trial++) {
        double size = 0;
        rates_at(&e->now, e->now.t, e->now.y, rates);
        slopes_at(&e->now, e->now.t, e->now.y, jacobian, in_time);
        for (int c = 0; c < N_Z; c++)
            for (int r = 0; r < N_Z; r++) matrix[c * N_Z + r] = jacobian[(N_X + c) * N_Y + N_X + r];
        if (!factorised(matrix, pivots, N_Z)) return 0;
        solve(matrix, pivots, rates + N_X, N_Z);
        for (int r = 0; r < N_Z; r++) {
            double *z = e->now.y + N_X + r;
            size = fmax(size, fabs(rates[N_X + r]) / (e->set.atol + e->set.rtol * fabs(*z)));
            *z -= rates[N_X + r];
        }
        if (!isfinite(size)) return 0;
        if (size < 1e-3) return 1;
    }
    return 0;
#else
    (void)e;
    return 1;
#endif
}

static void arm(engine *e)
{
    if (N_G) indicators_at(&e->now, e->now.t, e->now.y, e->found);
    for (int g = 0; g < N_G; g++) e->now.armed[g] = e->found[g] >= 0;
}

/* Decide all at an event again and again until nothing changes and nothing is left to decide. */
static enum outcome decide(engine *e)
{
    point *now = &e->now;
    now->n_events++;
    now->has_jumped = 1;
    e->is_stepped = 0;
    for (int again = 0; again < ROUNDS; again++) {
        int changes = decided(now, 1);
        for (int round = 0; changes && round < ROUNDS; round++) changes = decided(now, 0);
        if (changes && now->m[STOP] == 0) now->m[STOP] = CHATTER, now->m[STOP + 1] = now->t;
        if (now->m[STOP] != 0) return STOPPED;
        if (!algebraics_solved(e)) return NO_ALGEBRAIC;
        arm(e);
        int is_left = 0;
        for (int g = 0; g < N_G; g++) is_left |= N_Z && !now->armed[g];
        if (!is_left) break;
    }
    return DONE;
}
