/* FMI 2.0: what only model exchange has. */

fmi2Status fmi2EnterEventMode(fmi2Component component) {
    ENTER(CONTINUOUS_MODE, "fmi2EnterEventMode");
    c->state.phase = EVENT_MODE;
    return fmi2OK;
}

fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo *info) {
    int has_jumped;
    ENTER(EVENT_MODE, "fmi2NewDiscreteStates");
    WANT(info, "The place for the event information is missing.");
    status = update_discrete(c, &has_jumped);
    info->newDiscreteStatesNeeded = fmi2False;     /* everything was decided until nothing changed */
    info->terminateSimulation = c->state.is_terminated ? fmi2True : fmi2False;
    info->nominalsOfContinuousStatesChanged = fmi2False;
    info->valuesOfContinuousStatesChanged = has_jumped ? fmi2True : fmi2False;
    info->nextEventTimeDefined = isfinite(c->state.next_event) ? fmi2True : fmi2False;
    info->nextEventTime = isfinite(c->state.next_event) ? c->state.next_event : 0.0;
    return (fmi2Status)status;
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component) {
    ENTER(EVENT_MODE, "fmi2EnterContinuousTimeMode");
    WANT(!c->state.is_cs, "Co-simulation has no continuous-time mode.");
    c->state.phase = CONTINUOUS_MODE;
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_return, fmi2Boolean *enter_event_mode,
                                       fmi2Boolean *terminate) {
    (void)no_return;
    ENTER(CONTINUOUS_MODE, "fmi2CompletedIntegratorStep");
    WANT(enter_event_mode && terminate, "The places for the answers are missing.");
    *enter_event_mode = *terminate = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component component, fmi2Real time) {
    ENTER(EVENT_MODE | CONTINUOUS_MODE, "fmi2SetTime");
    WANT(isfinite(time), "The time must be a finite number.");
    c->state.time = time;
    changed(c);
    return fmi2OK;
}

fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real x[], size_t n) {
    ENTER(CONTINUOUS_MODE, "fmi2SetContinuousStates");
    WANT(n == N_X && (!n || x), "The number of states is wrong.");
    WANT(are_finite(x, n), "A state was set to what is no finite number.");
    memcpy(c->state.x, x, n * sizeof(double));
    changed(c);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real rates[], size_t n) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | TERMINATED, "fmi2GetDerivatives");
    WANT(n == N_X && (!n || rates), "The number of derivatives is wrong.");
    if ((status = solve_start(c)) == OK && (status = need_rates(c)) == OK)
        memcpy(rates, c->ode, n * sizeof(double));
    return (fmi2Status)status;
}

fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real indicators[], size_t n) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | TERMINATED, "fmi2GetEventIndicators");
    WANT(n == N_I && (!n || indicators), "The number of event indicators is wrong.");
    if ((status = solve_start(c)) == OK && (status = need_indicators(c)) == OK)
        memcpy(indicators, c->indicators, n * sizeof(double));
    return (fmi2Status)status;
}

fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real x[], size_t n) {
    ENTER(INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | TERMINATED, "fmi2GetContinuousStates");
    WANT(n == N_X && (!n || x), "The number of states is wrong.");
    if ((status = solve_start(c)) == OK)
        memcpy(x, c->state.x, n * sizeof(double));
    return (fmi2Status)status;
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominals[], size_t n) {
    ENTER(INSTANTIATED | INITIALIZATION_MODE | EVENT_MODE | CONTINUOUS_MODE | TERMINATED, "fmi2GetNominalsOfContinuousStates");
    WANT(n == N_X && (!n || nominals), "The number of states is wrong.");
    memcpy(nominals, NOMINAL, n * sizeof(double));
    return fmi2OK;
}
