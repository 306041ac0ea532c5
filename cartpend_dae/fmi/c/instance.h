/* One instance of the model: its state, and what is computed from it. */
#ifndef CARTPEND_INSTANCE_H
#define CARTPEND_INSTANCE_H

#include <float.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define AT_LEAST_1(n) ((n) > 0 ? (n) : 1)
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define N_KNOWN (1 + N_X + N_U + N_P)            /* time, states, inputs, parameters */
#define N_MATRIX LARGER(N_V, N_X + N_Z + 1)      /* the largest system of equations that is solved */
#define SENTENCE 512

enum { OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3 };      /* as both standards count */

enum { INSTANCE = 1, SAVED_STATE = 2 };                     /* kinds of objects with a handle */

/* Where an instance is in its life; a call is allowed in a set of these. */
enum {
    INSTANTIATED = 1,
    INITIALIZATION_MODE = 2,
    EVENT_MODE = 4,
    CONTINUOUS_MODE = 8,
    STEP_MODE = 16,
    TERMINATED = 32,
    ANY_PHASE = 63
};

/* All that a run needs to go on: plain numbers, so that saving is copying. */
typedef struct {
    double time, start_time;
    double next_event;                   /* when time alone changes something, infinite if never [s] */
    double tolerance;
    double x[AT_LEAST_1(N_X)], m[AT_LEAST_1(N_M)], z[AT_LEAST_1(N_Z)], u[AT_LEAST_1(N_U)], p[AT_LEAST_1(N_P)];
    double starts[AT_LEAST_1(N_X)], given[AT_LEAST_1(N_X)];          /* start values that the importer set */
    double point[AT_LEAST_1(N_V)];                                    /* where the search for a start begins */
    double discretes[AT_LEAST_1(N_DISCRETES)], discretes_given[AT_LEAST_1(N_DISCRETES)];
    double u_slopes[AT_LEAST_1(N_U)];    /* of the inputs, over the next step of co-simulation [1/s] */
#if HAS_CS
    point now;                           /* where the engine stands */
#endif
    int phase;
    int is_cs, event_mode_used, early_return_allowed;
    int is_started;                      /* the states are those of a start that was solved */
    int is_solved;                       /* the algebraic variables belong to all the rest */
    int is_touched;                      /* something was set since the last step of co-simulation */
    int is_terminated;                   /* the model ended the run */
} State;

typedef struct Instance Instance;

struct Instance {
    int object;                          /* INSTANCE */
    State state;
    /* computed when asked for, from the state alone */
    double ode[AT_LEAST_1(N_X)], y[AT_LEAST_1(N_Y)], indicators[AT_LEAST_1(N_I)];
    int has_ode, has_y, has_indicators;
    /* room to work in */
    double new_x[AT_LEAST_1(N_X)], new_m[AT_LEAST_1(N_M)];
    double residual[N_MATRIX], step[N_MATRIX], trial[N_MATRIX], matrix[N_MATRIX * N_MATRIX];
    double known[N_KNOWN], d_z[AT_LEAST_1(N_Z)], d_ode[AT_LEAST_1(N_X)], d_alg[AT_LEAST_1(N_Z)];
    double d_y[AT_LEAST_1(N_Y)], d_i[AT_LEAST_1(N_I)];
    int pivots[N_MATRIX];
    const casadi_real *arg[SIZE_ARG + 16];
    casadi_real *res[SIZE_RES + 8];
    casadi_int iw[SIZE_IW + 1];
    casadi_real w[SIZE_W + 1];
#if HAS_CS
    engine engine;
#endif
    /* the importer */
    void (*say)(Instance *, int status, const char *category, const char *sentence);
    void *environment;
    void (*callback)(void), (*intermediate)(void);
    int is_requested;                    /* the importer asks to return early */
    double requested_time;
    int is_logging, logs_errors, logs_warnings;
    char name[128];
};

typedef int (*Function)(const casadi_real **, casadi_real **, casadi_int *, casadi_real *, int);

/* Log a sentence and return its status. */
static int refuse(Instance *c, int status, const char *format, ...) {
    char sentence[SENTENCE];
    va_list list;
    va_start(list, format);
    vsnprintf(sentence, sizeof sentence, format, list);
    va_end(list);
    if (c->say)
        c->say(c, status, status == WARNING ? "logStatusWarning" : "logStatusError", sentence);
    return status;
}

/* Forget what was computed from the state. */
static void changed(Instance *c) {
    c->has_ode = c->has_y = c->has_indicators = 0;
    c->state.is_solved = 0;
}

static int are_finite(const double *values, size_t n) {
    for (size_t k = 0; k < n; k++)
        if (!isfinite(values[k]))
            return 0;
    return 1;
}

#endif
