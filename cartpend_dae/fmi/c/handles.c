/* Handles of instances and of saved states: what an importer holds is the address of a slot in a table, never that of
 * the memory itself. So a handle that was freed, or was never one, is told without reading what it points to. The table
 * is all that instances share. */
#define N_SLOTS 65536

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

/* Return a handle for an object, which begins with its kind, NULL if there are too many. The search goes round, so that
 * a slot rests before it is used again. */
static void *handle_for(void *object) {
    static volatile unsigned next = 0;
    unsigned first = next;
    for (unsigned k = 0; k < N_SLOTS; k++) {
        unsigned slot = (first + k) % N_SLOTS;
        if (exchanged(&slots[slot], NULL, object)) {
            next = slot + 1;
            return (void *)&slots[slot];
        }
    }
    return NULL;
}

/* Return the object of a handle, NULL if it has none of this kind. */
static void *object_of(const void *handle, int kind) {
    uintptr_t at = (uintptr_t)handle, first = (uintptr_t)&slots[0];
    if (at < first || at >= first + sizeof slots || (at - first) % sizeof slots[0])
        return NULL;
    void *object = *(void *const volatile *)handle;
    return object && *(const int *)object == kind ? object : NULL;
}

static void free_handle(void *handle, int kind) {
    void *object = object_of(handle, kind);
    if (object && exchanged((void *volatile *)handle, object, NULL))
        free(object);
}

static Instance *instance_of(void *handle) { return object_of(handle, INSTANCE); }
