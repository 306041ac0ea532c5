/* What both hosts share: loading an FMU's library, and counting what went wrong. */
#ifndef HOST_H
#define HOST_H
#include <dlfcn.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int failures = 0, refusals = 0, n_calls = 0;

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            failures++;                                                                                                \
            printf("%s:%d: %s\n", __FILE__, __LINE__, #condition);                                                     \
        }                                                                                                              \
    } while (0)

static void *library;

static void *symbol(const char *name) {
    void *found = dlsym(library, name);
    if (!found) {
        failures++;
        printf("%s is missing\n", name);
        exit(1);
    }
    return found;
}

static uint64_t seed = 1;

/* Random whole numbers below n, the same in every run (D. H. Lehmer's generator, with the numbers of Park and Miller). */
static unsigned below(unsigned n) {
    seed = seed * 48271 % 2147483647;
    return (unsigned)(seed % n);
}

/* Begin the numbers of sequence k. */
static void begin_numbers(unsigned k) { seed = (k + 1) * 2654435761u % 2147483647 + 1; }

static double number(void) {
    switch (below(12)) {
    case 0: return NAN;
    case 1: return INFINITY;
    case 2: return -1e308;
    case 3: return 0;
    default: return (below(20001) - 10000.0) / 5000;
    }
}
#endif
