/* The one file to compile: the functions that CasADi wrote, the model in them, and FMI around it.
 *
 *     cc -O2 -shared -fPIC -fvisibility=hidden all.c -o MODEL.so -lm
 *
 * Only the functions of FMI are seen from outside. */
#define CASADI_SYMBOL_EXPORT static
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#endif
#include "functions.c"
#if HAS_CS
#include "engine_sizes.h"
#include "engine.h"
#include "engine_methods.c"
#include "engine_events.c"
#include "engine_leaps.c"
#include "engine_run.c"
#include "engine_end.h"
#endif
#include "model.h"
#include "instance.h"
#include "linear.c"
#include "handles.c"
#include "evaluate.c"
#include "start.c"
#include "events.c"
#include "values.c"
#include "derivatives.c"
#include "snapshot.c"
#if HAS_CS
#include "solver.c"
#endif
#include FMI_LAYER
