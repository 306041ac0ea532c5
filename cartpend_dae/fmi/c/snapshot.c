/* Saved states: a copy of all numbers, with marks that tell a copy of this very export from anything else. */

typedef struct {
    char mark[16], token[64];
    State state;
} Snapshot;

static const char MARK[16] = "cartpend state";

static int is_snapshot(const Snapshot *kept) {
    return !memcmp(kept->mark, MARK, sizeof MARK) && !strncmp(kept->token, MODEL_TOKEN, sizeof kept->token);
}

static int save(Instance *c, void **where) {
    if (!where)
        return refuse(c, ERROR, "There is no place for the saved state.");
    Snapshot *kept = *where ? *where : calloc(1, sizeof *kept);
    if (!kept)
        return refuse(c, ERROR, "There is no memory to save the state.");
    if (*where && !is_snapshot(kept))
        return refuse(c, ERROR, "What should be overwritten is no saved state of %s.", MODEL_NAME);
    memcpy(kept->mark, MARK, sizeof MARK);
    strncpy(kept->token, MODEL_TOKEN, sizeof kept->token - 1);
    kept->state = c->state;
    *where = kept;
    return OK;
}

static int restore(Instance *c, const Snapshot *kept) {
    if (!kept || !is_snapshot(kept) || kept->state.is_cs != c->state.is_cs)
        return refuse(c, ERROR, "What was given is no saved state of %s.", MODEL_NAME);
    c->state = kept->state;
    c->has_ode = c->has_y = c->has_indicators = 0;
    return OK;
}

static int forget(Instance *c, void **where) {
    if (!where || !*where)
        return OK;
    if (!is_snapshot(*where))
        return refuse(c, ERROR, "What should be freed is no saved state of %s.", MODEL_NAME);
    memset(*where, 0, sizeof(Snapshot));
    free(*where);
    *where = NULL;
    return OK;
}

static int write_bytes(Instance *c, const Snapshot *kept, unsigned char *bytes, size_t size) {
    if (!kept || !is_snapshot(kept) || !bytes || size < sizeof *kept)
        return refuse(c, ERROR, "A saved state of %s takes %zu bytes; there is room for %zu.", MODEL_NAME,
                      sizeof(Snapshot), size);
    memcpy(bytes, kept, sizeof *kept);
    return OK;
}

static int read_bytes(Instance *c, const unsigned char *bytes, size_t size, void **where) {
    Snapshot *kept = NULL;
    if (!where || !bytes || size < sizeof *kept || !(kept = malloc(sizeof *kept)))
        return refuse(c, ERROR, "A saved state of %s takes %zu bytes; there are %zu.", MODEL_NAME, sizeof(Snapshot),
                      size);
    memcpy(kept, bytes, sizeof *kept);
    int phase = kept->state.phase;
    if (!is_snapshot(kept) || kept->state.is_cs != c->state.is_cs || phase <= 0 || (phase & (phase - 1)) ||
        phase > TERMINATED) {
        free(kept);
        return refuse(c, ERROR, "The bytes are no saved state of %s.", MODEL_NAME);
    }
    *where = kept;
    return OK;
}
