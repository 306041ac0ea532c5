/* Saved states: a copy of all numbers; as bytes with marks that tell this very export from anything else. */

typedef struct {
    int object;                          /* SAVED_STATE */
    char mark[16], token[64];
    State state;
} Snapshot;

static const char MARK[16] = "cartpend state";

static int save(Instance *c, void **where) {
    if (!where)
        return refuse(c, ERROR, "There is no place for the saved state.");
    Snapshot *kept = object_of(*where, SAVED_STATE);
    if (*where && !kept)
        return refuse(c, ERROR, "What should be overwritten is no saved state of %s.", MODEL_NAME);
    if (!kept) {
        kept = calloc(1, sizeof *kept);
        if (!kept || !(*where = handle_for(kept))) {
            free(kept);
            return refuse(c, ERROR, "There is no memory to save the state.");
        }
    }
    kept->object = SAVED_STATE;
    memcpy(kept->mark, MARK, sizeof MARK);
    strncpy(kept->token, MODEL_TOKEN, sizeof kept->token - 1);
    kept->state = c->state;
    return OK;
}

static int restore(Instance *c, const void *handle) {
    const Snapshot *kept = object_of(handle, SAVED_STATE);
    if (!kept || kept->state.is_cs != c->state.is_cs)
        return refuse(c, ERROR, "What was given is no saved state of %s.", MODEL_NAME);
    c->state = kept->state;
    c->has_ode = c->has_y = c->has_indicators = 0;
    return OK;
}

static int forget(Instance *c, void **where) {
    if (!where || !*where)
        return OK;
    if (!object_of(*where, SAVED_STATE))
        return refuse(c, ERROR, "What should be freed is no saved state of %s.", MODEL_NAME);
    free_handle(*where, SAVED_STATE);
    *where = NULL;
    return OK;
}

static int n_bytes(Instance *c, const void *handle, size_t *size) {
    if (!size || !object_of(handle, SAVED_STATE))
        return refuse(c, ERROR, "What was given is no saved state of %s.", MODEL_NAME);
    *size = sizeof(Snapshot);
    return OK;
}

static int write_bytes(Instance *c, const void *handle, unsigned char *bytes, size_t size) {
    const Snapshot *kept = object_of(handle, SAVED_STATE);
    if (!kept || !bytes || size < sizeof *kept)
        return refuse(c, ERROR, "A saved state of %s takes %lu bytes; there is room for %lu.", MODEL_NAME,
                      (unsigned long)sizeof(Snapshot), (unsigned long)size);
    memcpy(bytes, kept, sizeof *kept);
    return OK;
}

/* Whether a state that came as bytes can be one of this model: all that decides where memory is read or written. */
static int is_sound(const Snapshot *kept, const Instance *c) {
    int phase = kept->state.phase;
    return kept->object == SAVED_STATE && !memcmp(kept->mark, MARK, sizeof MARK) &&
           !strncmp(kept->token, MODEL_TOKEN, sizeof kept->token) && kept->state.is_cs == c->state.is_cs && phase > 0 &&
           !(phase & (phase - 1)) && phase <= TERMINATED;
}

static int read_bytes(Instance *c, const unsigned char *bytes, size_t size, void **where) {
    Snapshot *kept = NULL;
    if (!where || !bytes || size < sizeof *kept || !(kept = malloc(sizeof *kept)))
        return refuse(c, ERROR, "A saved state of %s takes %lu bytes; there are %lu.", MODEL_NAME,
                      (unsigned long)sizeof(Snapshot), (unsigned long)size);
    memcpy(kept, bytes, sizeof *kept);
    void *handle = is_sound(kept, c) ? handle_for(kept) : NULL;
    if (!handle) {
        free(kept);
        return refuse(c, ERROR, "The bytes are no saved state of %s.", MODEL_NAME);
    }
    *where = handle;
    return OK;
}
