/* FMI 3.0: modes, time and states of model exchange, and what the other kinds share with it. */

static fmi3Status not_offered(fmi3Instance instance, const char *name, const char *what) {
    ENTER(ANY_PHASE, name);
    return (fmi3Status)refuse(c, ERROR, "%s: %s", name, what);
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance) {
    return not_offered(instance, "fmi3EnterConfigurationMode", "there are no structural parameters.");
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance) {
    return not_offered(instance, "fmi3ExitConfigurationMode", "there are no structural parameters.");
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance) {
    return not_offered(instance, "fmi3EvaluateDiscreteStates", "`fmi3UpdateDiscreteStates` decides at events.");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock, (void)time;
    return not_offered(instance, "fmi3ActivateModelPartition", "there is no scheduled execution.");
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *needs_update, fmi3Boolean *terminates,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed, fmi3Boolean *has_next,
                                    fmi3Float64 *next) {
    int has_jumped;
    ENTER(EVENT_MODE, "fmi3UpdateDiscreteStates");
    WANT(needs_update && terminates && nominals_changed && states_changed && has_next && next,
         "The places for the answers are missing.");
    status = update_discrete(c, &has_jumped);
    c->state.is_touched = 1;
    *needs_update = false;               /* everything was decided until nothing changed */
    *terminates = c->state.is_terminated != 0;
    *nominals_changed = false;
    *states_changed = has_jumped != 0;
    *has_next = isfinite(c->state.next_event) && !c->state.is_cs;
    *next = *has_next ? c->state.next_event : 0.0;
    return (fmi3Status)status;
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
    ENTER(EVENT_MODE, "fmi3EnterContinuousTimeMode");
    WANT(!c->state.is_cs, "Co-simulation has no continuous-time mode.");
    c->state.phase = CONTINUOUS_MODE;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_return, fmi3Boolean *enter_event_mode,
                                       fmi3Boolean *terminates) {
    (void)no_return;
    ENTER(CONTINUOUS_MODE, "fmi3CompletedIntegratorStep");
    WANT(enter_event_mode && terminates, "The places for the answers are missing.");
    *enter_event_mode = *terminates = false;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    ENTER(EVENT_MODE | CONTINUOUS_MODE, "fmi3SetTime");
    WANT(!c->state.is_cs, "In co-simulation only steps change the time.");
    WANT(isfinite(time), "The time must be a finite number.");
    c->state.time = time;
    changed(c);
    return fmi3OK;
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n) {
    ENTER(CONTINUOUS_MODE, "fmi3SetContinuousStates");
    WANT(n == N_X && (!n || x), "The number of states is wrong.");
    WANT(are_finite(x, n), "A state was set to what is no finite number.");
    memcpy(c->state.x, x, n * sizeof(double));
    changed(c);
    return fmi3OK;
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 rates[], size_t n) {
    ENTER(ANY_PHASE & ~INSTANTIATED, "fmi3GetContinuousStateDerivatives");
    WANT(n == N_X && (!n || rates), "The number of derivatives is wrong.");
    if ((status = solve_start(c)) == OK && (status = need_rates(c)) == OK && n)
        memcpy(rates, c->ode, n * sizeof(double));
    return (fmi3Status)status;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n) {
    ENTER(ANY_PHASE & ~INSTANTIATED, "fmi3GetEventIndicators");
    WANT(n == N_I && (!n || indicators), "The number of event indicators is wrong.");
    if ((status = solve_start(c)) == OK && (status = need_indicators(c)) == OK && n)
        memcpy(indicators, c->indicators, n * sizeof(double));
    return (fmi3Status)status;
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n) {
    ENTER(ANY_PHASE & ~INSTANTIATED, "fmi3GetContinuousStates");
    WANT(n == N_X && (!n || x), "The number of states is wrong.");
    if ((status = solve_start(c)) == OK && n)
        memcpy(x, c->state.x, n * sizeof(double));
    return (fmi3Status)status;
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[], size_t n) {
    ENTER(ANY_PHASE, "fmi3GetNominalsOfContinuousStates");
    WANT(n == N_X && (!n || nominals), "The number of states is wrong.");
    if (n)
        memcpy(nominals, NOMINAL, n * sizeof(double));
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
    ENTER(ANY_PHASE, "fmi3GetNumberOfEventIndicators");
    WANT(n, "The place for the answer is missing.");
    *n = N_I;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) {
    ENTER(ANY_PHASE, "fmi3GetNumberOfContinuousStates");
    WANT(n, "The place for the answer is missing.");
    *n = N_X;
    return fmi3OK;
}
