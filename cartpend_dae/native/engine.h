/* A hybrid model in C, and what runs it: steps with error control, located events, decisions, clocks.
 *
 * The model is a set of functions that CasADi writes, of arguments t, y = [x; z], m, w, p:
 *   model_rates       x' and the residuals of the algebraic equations
 *   model_slopes      derivatives of the rates in y (by columns) and in t
 *   model_indicators  an event is where one of them falls through zero
 *   model_decisions   (with is_first) y, m and whether anything changed: one round of decisions at an event
 *   model_ticks       the next tick of all clocks
 * x are states, z algebraic variables, m the memory that events alone change, p parameters, and w are the inputs: values
 * at a time `begin`, slopes, and `begin` itself. The sizes N_X, N_Z, N_M, N_W, N_P and N_G (indicators) are macros, as
 * are the sizes of the work space (WORK_model_rates ...), and IS_LEAPING: whether exponential.c is in use. Element STOP
 * of the memory tells why the run has stopped (0: it has not), the next one when. Nothing here keeps state of its own,
 * so that many runs may go at once.
 */
#include <float.h>
#include <math.h>
#include <string.h>

#define N_Y (N_X + N_Z)
#define ROOM(n) ((n) > 0 ? (n) : 1)
#define N_STAGES 8
/* the matrix of a step of few states is inverted: a product is faster than a solution, eight times in a step */
#define IS_INVERTED (N_Z == 0 && N_X <= 12)

enum method { EXPLICIT = 0, IMPLICIT = 1 };

/* what became of a step or of a run; the negative ones are failures */
enum outcome { DONE = 0, EVENT = 1, STOPPED = 2, NOT_FINITE = -1, TOO_SMALL = -2, TOO_MANY = -3, NO_ALGEBRAIC = -4 };

typedef struct {
    double rtol, atol; /* tolerances of a step */
    double longest;    /* longest step [s] */
    double most_steps; /* so many in a run */
    double method;     /* EXPLICIT or IMPLICIT */
} settings;

#if IS_LEAPING
#define N_NODES 3
#define N_KEPT 4

/* Matrices of a step of length h: what the rates at its begin, and the differences at its nodes, add at each node; what
 * the nodes do not see of the changes that the rates make; and what a change at the begin is at the end. */
typedef struct {
    double h, free[N_NODES][N_X * N_X], driven[N_NODES][N_NODES][N_X * N_X], unseen[N_X * N_X], decay[N_X * N_X];
} propagator;

/* What leaps have learnt. */
typedef struct {
    double is_known, linear[N_X * N_X]; /* a Jacobian of the rates from an earlier point */
    double n_widths, oldest, widths[N_KEPT]; /* lengths of steps that it was used with [s] */
    double has_leapt, is_leaping;     /* since the last tick; with the last step */
    double usual, between;            /* so many ordinary steps were needed between two ticks, and their distance [s] */
    double steps_before, tick_before; /* steps made, and time [s], at the last tick */
    double cost;                      /* of this leap, in ordinary steps */
    double wait, last_wait;           /* ticks until the next attempt, and how many they were last */
} leaper;
#endif

/* Where a run stands: all that decides how it goes on, without pointers, so that a copy of it is a saved state. */
typedef struct {
    double t;              /* time [s] */
    double step;           /* next step [s] */
    double first_step;     /* step that was right after the last jump [s], 0: not known */
    double last_step, last_error; /* length of the last step [s], and its error over the tolerance */
    double has_jumped;     /* whether nothing was stepped since the last jump */
    double y[ROOM(N_Y)], m[ROOM(N_M)], w[ROOM(N_W)], p[ROOM(N_P)];
    double armed[ROOM(N_G)]; /* whether an indicator was above zero, and so may fall through it */
    double n_steps, n_rejected, n_trials, n_events;
#if IS_LEAPING
    leaper leaper;
#endif
} point;

/* A run: where it stands, and its last step with what the dense output needs. */
typedef struct {
    settings set;
    point now;
    double t_0, h, is_stepped, is_cut;     /* its begin and length; whether it goes on; whether it reached its target */
    double m_0[ROOM(N_M)];                 /* the memory in it */
    double until;                          /* what holds in it, holds at times before this */
    double y_0[ROOM(N_Y)], y_1[ROOM(N_Y)]; /* its begin and its end */
    double k[N_STAGES][ROOM(N_Y)];         /* its stages */
    double dense[4][ROOM(N_Y)];
    double is_rough;                       /* whether the dense output needs correction, -1: not asked yet */
    double error[ROOM(N_Y)];
    double jacobian[ROOM(N_Y * N_Y)], in_time[ROOM(N_Y)]; /* at its begin */
    double matrix[ROOM(N_Y * N_Y)]; /* factors, or the inverse */
    int pivots[ROOM(N_Y)];
    double found[ROOM(N_G)]; /* indicators */
#if IS_LEAPING
    double output_at; /* the next output time [s] */
    double kept_of[N_X * N_X];
    propagator kept[N_KEPT]; /* matrices of `kept_of` and the widths; h is 0 where there are none */
#endif
} engine;

/* Evaluate a function of the model; its work space is on the stack. */
#define EVALUATE(name, ...)                              \
    do {                                                 \
        const double *arguments[ARGUMENTS_##name];       \
        double *results[RESULTS_##name];                 \
        double work[ROOM(WORK_##name)];                  \
        casadi_int numbers[ROOM(NUMBERS_##name)];        \
        __VA_ARGS__;                                     \
        name(arguments, results, numbers, work, 0);      \
    } while (0)

static void given(const double **arguments, const point *now, const double *t, const double *y)
{
    arguments[0] = t, arguments[1] = y, arguments[2] = now->m, arguments[3] = now->w, arguments[4] = now->p;
}

static void rates_at(const point *now, double t, const double *y, double *rates)
{
    EVALUATE(model_rates, given(arguments, now, &t, y), results[0] = rates);
}

static void slopes_at(const point *now, double t, const double *y, double *jacobian, double *in_time)
{
    EVALUATE(model_slopes, given(arguments, now, &t, y), results[0] = jacobian, results[1] = in_time);
}

static void indicators_at(const point *now, double t, const double *y, double *found)
{
    EVALUATE(model_indicators, given(arguments, now, &t, y), results[0] = found);
}

static double next_tick(const point *now)
{
    double tick;
    EVALUATE(model_ticks, given(arguments, now, &now->t, now->y), results[0] = &tick);
    return tick;
}

/* Decide once; return whether anything changed. */
static int decided(point *now, double is_first)
{
    double y[ROOM(N_Y)], m[ROOM(N_M)], changed;
    EVALUATE(model_decisions, given(arguments, now, &now->t, now->y), arguments[5] = &is_first,
             results[0] = y, results[1] = m, results[2] = &changed);
    memcpy(now->y, y, sizeof(double) * N_X);
    memcpy(now->m, m, sizeof(double) * N_M);
    return changed != 0;
}
