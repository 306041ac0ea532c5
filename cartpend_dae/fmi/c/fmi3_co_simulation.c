/* FMI 3.0: what only co-simulation has. With event mode a step returns at each event, after it was decided. */

fmi3Status fmi3EnterStepMode(fmi3Instance instance) {
    ENTER(EVENT_MODE, "fmi3EnterStepMode");
    WANT(c->state.is_cs, "Model exchange has no step mode.");
    c->state.phase = STEP_MODE;
    return fmi3OK;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference vr[], size_t n,
                                    const fmi3Int32 orders[], fmi3Float64 values[], size_t n_values) {
    (void)orders, (void)values, (void)n_values;
    return no_such(instance, vr, n, "fmi3GetOutputDerivatives");
}

#if HAS_CS
/* Tell the importer after a step of the solver; return whether the communication step ends here. */
static int ends_here(Instance *c, int is_event) {
    fmi3IntermediateUpdateCallback update = (fmi3IntermediateUpdateCallback)c->intermediate;
    State *s = &c->state;
    if (update) {
        fmi3Boolean is_requested = false;
        fmi3Float64 time = s->time;
        update(c->environment, s->time, false, true, true, s->early_return_allowed != 0, &is_requested, &time);
        if (is_requested && s->early_return_allowed) {
            c->is_requested = 1;
            return 1;
        }
    }
    return is_event && s->event_mode_used;
}
#endif

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_return,
                      fmi3Boolean *needs_event, fmi3Boolean *terminates, fmi3Boolean *is_early, fmi3Float64 *reached) {
    (void)no_return;
    ENTER(STEP_MODE, "fmi3DoStep");
    WANT(needs_event && terminates && is_early && reached, "The places for the answers are missing.");
    WANT(isfinite(time) && isfinite(step) && step > 0, "The length of a step must be a positive number.");
    WANT(fabs(time - c->state.time) <= 1e-9 * (1 + fabs(time)), "The step does not begin where the last one ended.");
#if HAS_CS
    c->is_requested = 0;
    int watches = c->intermediate || c->state.event_mode_used;
    status = run_to(c, time + step, watches ? ends_here : NULL);
    *reached = c->state.time;
    *terminates = c->state.is_terminated != 0;
    *is_early = *reached < time + step - 1e-12 * (1 + fabs(time + step));
    *needs_event = c->state.event_mode_used && *is_early && !c->is_requested;
    return (fmi3Status)status;
#else
    return fmi3Error;
#endif
}
