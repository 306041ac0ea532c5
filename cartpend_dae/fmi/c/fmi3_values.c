/* FMI 3.0: reading and writing variables; of the many types the model has Float64, Int32 and Boolean. */

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                          size_t n_values) {
    ENTER(ANY_PHASE, "fmi3GetFloat64");
    WANT(n == n_values && (!n || (vr && values)), "The value references or values are missing, or not as many.");
    for (size_t k = 0; k < n && status == OK; k++)
        status = get_value(c, vr[k], REAL, &values[k]);
    return (fmi3Status)status;
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t n_values) {
    ENTER(ANY_PHASE & ~TERMINATED, "fmi3SetFloat64");
    WANT(n == n_values && (!n || (vr && values)), "The value references or values are missing, or not as many.");
    return (fmi3Status)set_values(c, vr, values, n);
}

fmi3Status fmi3GetInt32(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                        size_t n_values) {
    ENTER(ANY_PHASE, "fmi3GetInt32");
    WANT(n == n_values && (!n || (vr && values)), "The value references or values are missing, or not as many.");
    for (size_t k = 0; k < n && status == OK; k++) {
        double value;
        if ((status = get_value(c, vr[k], INTEGER, &value)) == OK)
            values[k] = (fmi3Int32)value;
    }
    return (fmi3Status)status;
}

fmi3Status fmi3GetBoolean(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Boolean values[],
                          size_t n_values) {
    ENTER(ANY_PHASE, "fmi3GetBoolean");
    WANT(n == n_values && (!n || (vr && values)), "The value references or values are missing, or not as many.");
    for (size_t k = 0; k < n && status == OK; k++) {
        double value;
        if ((status = get_value(c, vr[k], BOOLEAN, &value)) == OK)
            values[k] = value != 0;
    }
    return (fmi3Status)status;
}

/* No variable of this type can be read or written; of none at all it is allowed. */
static fmi3Status no_such(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const char *name) {
    ENTER(ANY_PHASE, name);
    WANT(!n || vr, "The value references are missing.");
    if (n)
        return (fmi3Status)refuse(c, ERROR, "%s: the variable with the value reference %u is of another type, or the "
                                            "model computes it.", name, vr[0]);
    return fmi3OK;
}

#define NOTHING_OF(type)                                                                                               \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3##type values[],      \
                             size_t n_values) {                                                                        \
        (void)values, (void)n_values;                                                                                  \
        return no_such(instance, vr, n, "fmi3Get" #type);                                                              \
    }                                                                                                                  \
    NOT_SET(type)

#define NOT_SET(type)                                                                                                  \
    fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,                           \
                             const fmi3##type values[], size_t n_values) {                                             \
        (void)values, (void)n_values;                                                                                  \
        return no_such(instance, vr, n, "fmi3Set" #type);                                                              \
    }

NOTHING_OF(Float32)
NOTHING_OF(Int8)
NOTHING_OF(UInt8)
NOTHING_OF(Int16)
NOTHING_OF(UInt16)
NOTHING_OF(UInt32)
NOTHING_OF(Int64)
NOTHING_OF(UInt64)
NOTHING_OF(String)
NOT_SET(Int32)
NOT_SET(Boolean)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                         fmi3Binary values[], size_t n_values) {
    (void)sizes, (void)values, (void)n_values;
    return no_such(instance, vr, n, "fmi3GetBinary");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values) {
    (void)sizes, (void)values, (void)n_values;
    return no_such(instance, vr, n, "fmi3SetBinary");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Clock values[]) {
    (void)values;
    return no_such(instance, vr, n, "fmi3GetClock");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[]) {
    (void)values;
    return no_such(instance, vr, n, "fmi3SetClock");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t *n) {
    (void)n;
    return no_such(instance, &vr, 1, "fmi3GetNumberOfVariableDependencies");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference vr, size_t elements[],
                                       fmi3ValueReference independents[], size_t independent_elements[],
                                       fmi3DependencyKind kinds[], size_t n) {
    (void)elements, (void)independents, (void)independent_elements, (void)kinds, (void)n;
    return no_such(instance, &vr, 1, "fmi3GetVariableDependencies");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]) {
    (void)intervals, (void)qualifiers;
    return no_such(instance, vr, n, "fmi3GetIntervalDecimal");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
    (void)counters, (void)resolutions, (void)qualifiers;
    return no_such(instance, vr, n, "fmi3GetIntervalFraction");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[]) {
    (void)shifts;
    return no_such(instance, vr, n, "fmi3GetShiftDecimal");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[]) {
    (void)counters, (void)resolutions;
    return no_such(instance, vr, n, "fmi3GetShiftFraction");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                  const fmi3Float64 intervals[]) {
    (void)intervals;
    return no_such(instance, vr, n, "fmi3SetIntervalDecimal");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                   const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)counters, (void)resolutions;
    return no_such(instance, vr, n, "fmi3SetIntervalFraction");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                               const fmi3Float64 shifts[]) {
    (void)shifts;
    return no_such(instance, vr, n, "fmi3SetShiftDecimal");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]) {
    (void)counters, (void)resolutions;
    return no_such(instance, vr, n, "fmi3SetShiftFraction");
}
