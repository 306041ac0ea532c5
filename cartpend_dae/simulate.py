"""Run a model: adaptive by CasADi's integrators, or with a fixed step as older studies did."""

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, get_args

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble, check_bounds
from cartpend_dae.begin import Begin, started
from cartpend_dae.continuous import without_events
from cartpend_dae.dae import dae, parameter_vector
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.initialize import Start, initialize, unknown_parameters
from cartpend_dae.inputs import (
    DrivenInputs,
    Input,
    checked_inputs,
    driven_inputs,
    input_values,
    refined,
    with_knots,
)
from cartpend_dae.integrate import Run, integrate, trajectory
from cartpend_dae.language import Component
from cartpend_dae.plugins import Choice, Method
from cartpend_dae.prepared import content, once
from cartpend_dae.quantities import is_number
from cartpend_dae.singular import check_regular
from cartpend_dae.start_conditions import Steady
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.system import System
from cartpend_dae.time_events import with_time_events
from cartpend_dae.trouble import trouble_at


def simulate(
    model: Component | System,
    stop: float | None = None,
    *,
    times: Sequence[float] | np.ndarray | None = None,
    points: int = 501,
    inputs: Mapping[str, Input] | None = None,
    start: Mapping[str, float] | None = None,
    parameters: Mapping[str, float] | None = None,
    unknown: Mapping[str, float] | None = None,
    steady: Steady = False,
    method: Method = "adaptive",
    step: float | None = None,
    rtol: float = 1e-8,
    atol: float = 1e-10,
    compile: bool = False,
) -> Trajectory:
    """Simulate a model from consistent start values.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    stop
        End of the simulation [s]; it starts at 0. Not needed with `times`.
    times
        Output times [s], strictly increasing; the first is the start.
    points
        Number of equally spaced output times if `times` is not given.
    inputs
        By input name: a number, a function of time in CasADi terms, or a pair (times, values) of samples,
        joined linearly; a third item ``"zoh"`` holds each sample until the next. SI units.
    start
        Start values by variable name, in SI units; they overrule those of the model.
    parameters
        Other values of parameters, by name, in SI units; one that the model calls `unknown` is known then.
    unknown
        Guesses of parameters that the start determines, by name, in SI units, besides those of the model.
    steady
        True starts at rest: all derivatives are zero, and `start` says which rest is meant, and what no rest
        determines. A list of names makes the derivatives of these variables zero.
    method
        ``"adaptive"`` chooses among CasADi's integrators: cvodes for smooth explicit models, idas with algebraic
        variables, rosenbrock with events where there is dry friction. ``"rk4"`` is the classical Runge-Kutta
        method with the fixed `step`.
    step
        Step of ``"rk4"`` [s]; output intervals are divided into equal steps no longer than this. Without `times`
        every step is an output time, and the last one is shorter where `stop` is no multiple of it.
    rtol, atol
        Relative and absolute tolerance of the adaptive methods.
    compile
        True turns the integrator into machine code, kept on disk for the next run of the same model and output
        times: worth it for long runs and for many. Without a C compiler it changes nothing.

    Returns
    -------
    Trajectory
        Every variable of the model, and each parameter found, by its dotted name, shape (n_times,) each, SI units.

    Raises
    ------
    ModelError
        For an unknown name or method, what is no finite number, a missing input, output times that do not
        increase, or dry friction that cannot be: with a negative level, or between points that never move.
    SolverError
        If no consistent start exists or the integration fails.
    """
    check_method(method, step, {"rtol": rtol, "atol": atol})
    grid = output_grid(stop, times, points, step if method == "rk4" else None)
    asked = Asked(inputs, start, parameters, unknown, steady)
    ready = prepared_run(assemble(model), grid, asked, is_fixed=method == "rk4")
    begin, driven, fine = ready.begin, ready.driven, ready.fine
    if method == "rk4" and step is not None:
        run = _fixed_steps(begin, driven, fine, step)
    else:
        run = integrate(begin, driven, fine, Choice(method, rtol, atol, compile))
    return trajectory(begin, run, driven, fine, grid).with_constants(
        begin.found, [_unit(begin, name) for name in begin.found]
    )


@dataclass(frozen=True, slots=True)
class Asked:
    """What the caller of a run gives besides its times, as `simulate` takes it."""

    inputs: Mapping[str, Input] | None = None
    start: Mapping[str, float] | None = None
    parameters: Mapping[str, float] | None = None
    unknown: Mapping[str, float] | None = None
    steady: Steady = False


@dataclass(frozen=True, slots=True)
class Ready:
    """A run before its first step: its start, and inputs over the intervals of the `fine` grid of all known times."""

    begin: Begin
    driven: DrivenInputs
    fine: np.ndarray


def prepared_run(
    system: System,
    grid: np.ndarray,
    asked: Asked,
    *,
    is_fixed: bool = False,
    search: Callable[..., Start] = initialize,
    with_times: bool = True,
) -> Ready:
    """Check what the caller gives, and find the start of a run.

    Parameters
    ----------
    system, grid, asked
        The system, the output times (n,) [s], and what the caller gives.
    is_fixed
        Whether the steps are fixed, so that events are stepped over.
    search
        What finds the start: `initialize`, or one that keeps more of it.
    with_times
        Whether events that time alone decides are points of the grid, computed before the run.
    """
    known = _named("parameters", asked.parameters)
    p = parameter_vector(system, known)
    check_bounds(system, p)
    check_regular(system, p)
    if is_fixed:
        system = without_events(system, "Method `rk4`")
    every = checked_inputs(system, _named("inputs", asked.inputs))
    fine = with_knots(grid, every)
    driven = driven_inputs(every, fine)
    found = unknown_parameters(system, known, _named("unknown", asked.unknown))
    if with_times:
        system, fine, driven = with_time_events(system, p, fine, driven)
    u_0 = input_values(driven, fine[:1], driven.left[:, :1])[:, 0]
    begins, time = _start_values(asked.start), float(grid[0])
    begin = started(system, p, u_0, partial(search, start=begins, time=time, unknown=found, steady=asked.steady), fine)
    _check_start(begin, u_0, time)
    _check_frictions(begin, u_0, time)
    return Ready(begin, driven, fine)


def _unit(begin: Begin, name: str) -> str:
    system = begin.system
    return system.parameters[system.parameter_index(name)].declaration.unit


def check_method(method: str, step: float | None, tolerances: dict[str, float]) -> None:
    """Refuse an unknown method, a step that does not fit it, and tolerances that are not positive."""
    if method not in get_args(Method):
        known = ", ".join(f"`{name}`" for name in get_args(Method))
        raise ModelError(f"There is no method {method!r}; choose one of {known}.")
    if (step is None and method == "rk4") or not (step is None or _is_positive(step)):
        raise ModelError(f"Method `rk4` needs a positive `step` in seconds, not {step!r}.")
    for name, value in tolerances.items():
        if not _is_positive(value):
            raise ModelError(f"The tolerance `{name}` must be a positive number, not {value!r}.")


def _is_positive(value: object) -> bool:
    return is_number(value) and 0 < value < math.inf


def _named(argument: str, values: Mapping[str, Any] | None) -> dict[str, Any]:
    if values is not None and not isinstance(values, Mapping):
        raise ModelError(f"`{argument}` must be a dictionary of names and values, not {reprlib.repr(values)}.")
    return dict(values or {})


def _start_values(start: Mapping[str, float] | None) -> dict[str, float]:
    values = _named("start", start)
    for name, value in values.items():
        if not is_number(value):
            raise ModelError(f"The start value of `{name}` must be a number, not {value!r}.")
    return values


def output_grid(
    stop: float | None, times: Sequence[float] | np.ndarray | None, points: int, step: float | None
) -> np.ndarray:
    """Return the output times (n,) [s] of a run as `simulate` takes them."""
    if times is not None:
        try:
            grid = np.asarray(times, dtype=float)
        except (TypeError, ValueError):
            raise ModelError(f"The output `times` must be numbers in seconds, not {reprlib.repr(times)}.") from None
    elif stop is None:
        raise ModelError("`simulate` needs `stop`, the end of the simulation in seconds, or output `times`.")
    elif not is_number(stop):
        raise ModelError(f"`stop` must be a number, the end of the simulation in seconds, not {stop!r}.")
    elif not isinstance(points, int | np.integer):
        raise ModelError(f"`points` must be a whole number of output times, not {points!r}.")
    elif not _is_positive(stop):
        grid = np.zeros(0)
    elif step is not None:
        grid = np.append(np.arange(math.ceil(stop / step - 1e-9)) * step, stop)
    else:
        grid = np.linspace(0.0, stop, max(points, 0))
    if grid.ndim != 1 or grid.size < 2 or not np.all(np.isfinite(grid)) or not np.all(np.diff(grid) > 0):
        raise ModelError("`simulate` needs at least two output times that increase strictly; check `stop` and `times`.")
    return grid


def _check_start(begin: Begin, u: np.ndarray, time: float) -> None:
    system = begin.between
    key = (content(begin.x, begin.z, begin.inputs(u), begin.p), time)
    once(system, "rates at the start", key, lambda: _check_rates(begin, u, time))


def _check_rates(begin: Begin, u: np.ndarray, time: float) -> None:
    system = begin.between
    ode, _ = dae(system).rhs(time, begin.x, begin.z, begin.inputs(u), begin.p, np.zeros(system.frictions.force.numel()))
    bad = [name for name, value in zip(system.states, np.asarray(ode).ravel(), strict=True) if not np.isfinite(value)]
    if bad:
        listing = ", ".join(f"`{name}`" for name in bad)
        raise SolverError(
            f"{system.name}: the derivative of {listing} is not finite at the start: a mass, inertia, inductance "
            f"or ratio is zero ({trouble_at(system, time, begin.x, begin.z, begin.inputs(u), begin.p)}). Check the "
            f"parameters in its equation (`cartpend check` prints it)."
        )


def _check_frictions(begin: Begin, u: np.ndarray, time: float) -> None:
    """Refuse dry friction whose speed nothing can change, or whose level is negative at the start."""
    system = begin.between
    f, findings = system.frictions, []
    if not f.places:
        return
    moves, levels = once(system, "moves and levels", None, lambda: _moves_and_levels(system))
    point = (begin.x, begin.z, begin.inputs(u), begin.p)
    key = (time, content(*point))
    values = once(system, "levels at the start", key, lambda: levels(time, *point, np.zeros(len(f.places))))
    for place, is_moving, *pair in zip(f.places, moves, *(np.asarray(v).ravel() for v in values), strict=True):
        if not is_moving:
            findings.append(
                f"the dry friction at `{place}` stands between points that never move against each other, so that "
                f"nothing determines its force: connect it to a body that moves, or leave it out"
            )
        findings += [
            f"the dry friction at `{place}` has the level {level:g} at the start ({time:g} s), but a level is not "
            f"negative: check what it is computed from"
            for level in sorted(set(pair))
            if not level >= 0
        ]
    if findings:
        raise ModelError(f"{system.name}: {'; '.join(sorted(findings))}.")


def _moves_and_levels(system: System) -> tuple[Sequence[bool], ca.Function]:
    """Return whether anything can change the speed of each dry friction, and a function of their levels."""
    f, moving = system.frictions, ca.vertcat(system.x, system.z, system.u, system.time)
    arguments = [system.time, system.x, system.z, system.u, system.p, f.force]
    levels = ca.Function("levels", arguments, [f.level_pos, f.level_neg])
    return ca.which_depends(f.speed, moving, 1, True), levels


def _fixed_steps(begin: Begin, driven: DrivenInputs, grid: np.ndarray, step: float) -> Run:
    """Step over the grid, divided into steps no longer than `step`."""
    system, p = begin.between, begin.p
    times, inputs, where = refined(driven, grid, step)
    widths = np.diff(times)
    left = input_values(inputs, times[:-1], inputs.left)
    right = input_values(inputs, times[1:], inputs.left + inputs.slope * widths)
    stepper = runge_kutta(system)
    run = stepper.function.mapaccum("run", widths.size, ["x"], ["x_next"])
    start = np.concatenate([begin.x, begin.z])
    result = run(t=times[:-1], h=widths, x=start, u_a=left, u_b=right, p=np.tile(p[:, None], widths.size))
    x = np.column_stack([start, np.asarray(result["x_next"])])
    if not np.all(np.isfinite(x)):
        first = times[int(np.flatnonzero(~np.isfinite(x).all(axis=0))[0])]
        raise SolverError(
            f"{system.name}: rk4 with step {step:g} s is unstable: not finite from {first:g} s on; use a smaller step."
        )
    if begin.z.size:
        now, wide = np.column_stack([left, right[:, -1:]]), np.append(widths, widths[-1])
        x[begin.x.size :] = stepper.algebraic.map(times.size)(times, wide, x, now, np.tile(p[:, None], times.size))
    x, z = np.vsplit(x[:, where], [begin.x.size])
    return Run(x, z, None)
