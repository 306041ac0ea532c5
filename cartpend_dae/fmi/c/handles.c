/* Handles of instances: what an importer holds is the address of a slot in a table, never that of the memory itself.
 *
 * So a handle that was freed, or was never one, is told without reading it. The table is all that instances share. */
#define N_SLOTS 4096

static void *volatile slots[N_SLOTS];

#if defined(_MSC_VER)
#include <intrin.h>
static int exchanged(void *volatile *slot, void *before, void *after) {
    return _InterlockedCompareExchangePointer(slot, after, before) == before;
}
#else
static int exchanged(void *volatile *slot, void *before, void *after) {
    return __sync_bool_compare_and_swap(slot, before, after);
}
#endif

/* Return a handle for an instance, NULL if there are too many. The search goes round, so that a slot rests. */
static void *handle_for(Instance *c) {
    static volatile unsigned next = 0;
    unsigned first = next;
    for (unsigned k = 0; k < N_SLOTS; k++) {
        unsigned slot = (first + k) % N_SLOTS;
        if (exchanged(&slots[slot], NULL, c)) {
            next = slot + 1;
            return (void *)&slots[slot];
        }
    }
    return NULL;
}

/* Return the instance of a handle, NULL if it has none. */
static Instance *instance_of(void *handle) {
    uintptr_t at = (uintptr_t)handle, first = (uintptr_t)&slots[0];
    if (at < first || at >= (uintptr_t)&slots[N_SLOTS] || (at - first) % sizeof slots[0])
        return NULL;
    return (Instance *)*(void *volatile *)handle;
}

static void free_handle(void *handle) {
    Instance *c = instance_of(handle);
    if (c && exchanged((void *volatile *)handle, c, NULL)) {
        free(c->solver);
        free(c);
    }
}
