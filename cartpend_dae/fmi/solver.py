"""The solver of a co-simulation FMU: the engine of `native`, with the sizes and functions of the model."""

from dataclasses import replace

import casadi as ca
import numpy as np

from cartpend_dae.fmi.equations import Equations
from cartpend_dae.fmi.start import StartProblem
from cartpend_dae.native.model import ENGINE, NEVER, NativeModel, engine_macros, engine_part, native_model
from cartpend_dae.plugins import MOST_STEPS, STABLE

# longest step as a part of the usual run, where something may be passed over
SHARE = 1 / 500


def solver_model(e: Equations) -> NativeModel:
    """Return what the engine runs: events of time alone are met at their instants, as ticks are."""
    model = native_model(e.system, e.made)
    if e.made is None:
        return model
    rates, slopes, indicators, decisions, ticks = model.functions
    given = [ca.SX.sym(ticks.name_in(i), ticks.sparsity_in(i)) for i in range(ticks.n_in())]
    time, _, memory, _, p = given
    next_time = ca.Function("next_time", [e.system.time, e.memory, e.system.p], [e.next_time])
    (soonest,) = next_time.call([time, memory, p], True, False)
    (every,) = indicators.call(given, True, False)
    kept = ca.Function("model_indicators", given, [ca.densify(every[list(e.kept), 0])])
    ticks = ca.Function("model_ticks", given, [ca.fmin(soonest, NEVER)])
    return replace(model, functions=(rates, slopes, kept, decisions, ticks), n_g=len(e.kept))


def engine_files(model: NativeModel) -> dict[str, str]:
    """Return the sources of the engine by the names that `all.c` includes."""
    names = dict(
        zip(ENGINE, ("engine.h", "engine_methods.c", "engine_events.c", "engine_leaps.c", "engine_run.c"), strict=True)
    )
    return {"engine_sizes.h": engine_macros(model)} | {names[part]: engine_part(part) for part in ENGINE}


def solver_macros(e: Equations, model: NativeModel, start: StartProblem, span: float) -> dict[str, str]:
    """Return how the solver steps: its method by the fastest rate at the start, and its longest step."""
    is_cut = e.made is not None or model.depends_on_time
    longest = repr(span * SHARE) if is_cut else "HUGE_VAL"
    is_stiff = e.system.z.numel() > 0 or _fastest_rate(e, start) * span / STABLE >= MOST_STEPS
    return {"LONGEST_STEP": longest, "METHOD": "IMPLICIT" if is_stiff else "EXPLICIT"}


def _fastest_rate(e: Equations, start: StartProblem) -> float:
    s, n_x = e.system, e.system.x.numel()
    slopes = ca.Function("slopes", e.arguments, [ca.densify(ca.jacobian(e.ode, s.x))])
    p = s.parameter_values
    p[list(start.unknown)] = start.point[start.point.size - len(start.unknown) :]
    values = np.asarray(slopes(0.0, start.point[:n_x], start.memory, [], start.u, p))
    return float(np.abs(np.linalg.eigvals(values)).max(initial=0.0)) if np.all(np.isfinite(values)) else np.inf
