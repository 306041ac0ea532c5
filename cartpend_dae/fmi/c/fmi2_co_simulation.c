/* FMI 2.0: what only co-simulation has. */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real values[]) {
    ENTER(INITIALIZATION_MODE | STEP_MODE, "fmi2SetRealInputDerivatives");
    WANT(c->state.is_cs, "Derivatives of inputs belong to co-simulation.");
    WANT(!n || (vr && order && values), "The value references, orders or values are missing.");
    for (size_t k = 0; k < n; k++) {
        if (vr[k] < FIRST_VALUE || vr[k] >= FIRST_RATE || INPUT_OF[vr[k] - FIRST_VALUE] < 0)
            return (fmi2Status)refuse(c, ERROR, "The value reference %u is no input.", vr[k]);
        WANT(order[k] == 1, "Inputs have first derivatives only.");
        WANT(isfinite(values[k]), "The derivative of an input must be a finite number.");
    }
    for (size_t k = 0; k < n; k++)
        c->state.u_slopes[INPUT_OF[vr[k] - FIRST_VALUE]] = values[k];
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real values[]) {
    (void)vr, (void)n, (void)order, (void)values;
    ENTER(ANY_PHASE, "fmi2GetRealOutputDerivatives");
    return (fmi2Status)refuse(c, ERROR, "Derivatives of outputs are not offered.");
}

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step, fmi2Boolean no_return) {
    (void)no_return;
    ENTER(STEP_MODE, "fmi2DoStep");
    WANT(isfinite(time) && isfinite(step) && step > 0, "The length of a step must be a positive number.");
    WANT(fabs(time - c->state.time) <= 1e-9 * (1 + fabs(time)), "The step does not begin where the last one ended.");
#if HAS_CS
    return (fmi2Status)run_to(c, time + step, NULL);
#else
    return fmi2Error;
#endif
}

fmi2Status fmi2CancelStep(fmi2Component component) {
    ENTER(ANY_PHASE, "fmi2CancelStep");
    return (fmi2Status)refuse(c, ERROR, "No step is under way: steps end before `fmi2DoStep` returns.");
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind, (void)value;
    ENTER(ANY_PHASE, "fmi2GetStatus");
    return (fmi2Status)refuse(c, DISCARD, "No step is under way: steps end before `fmi2DoStep` returns.");
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value) {
    ENTER(ANY_PHASE, "fmi2GetRealStatus");
    WANT(c->state.is_cs && kind == fmi2LastSuccessfulTime && value, "Only the last successful time can be asked for.");
    *value = c->state.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)kind, (void)value;
    ENTER(ANY_PHASE, "fmi2GetIntegerStatus");
    return (fmi2Status)refuse(c, DISCARD, "There is no such status.");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Boolean *value) {
    ENTER(ANY_PHASE, "fmi2GetBooleanStatus");
    WANT(c->state.is_cs && kind == fmi2Terminated && value, "Only whether the model ended the run can be asked for.");
    *value = c->state.is_terminated ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind, fmi2String *value) {
    (void)kind, (void)value;
    ENTER(ANY_PHASE, "fmi2GetStringStatus");
    return (fmi2Status)refuse(c, DISCARD, "There is no such status.");
}
