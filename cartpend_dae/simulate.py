"""Run a model: adaptive by CasADi's integrators, or with a fixed step as older studies did."""

import math
import reprlib
from collections.abc import Mapping, Sequence
from typing import Any, Literal, get_args

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble, check_bounds
from cartpend_dae.breakdown import breakdown_sentence
from cartpend_dae.dae import all_variables, dae, parameter_vector
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.events import HybridFriction, friction_events
from cartpend_dae.initialize import Start, algebraics_along, initialize, unknown_parameters
from cartpend_dae.inputs import (
    DrivenInputs,
    Input,
    checked_inputs,
    driven_inputs,
    input_values,
    inputs_at,
    refined,
    with_knots,
)
from cartpend_dae.integration import Integration
from cartpend_dae.language import Component
from cartpend_dae.quantities import is_number
from cartpend_dae.singular import check_regular
from cartpend_dae.start_conditions import Steady
from cartpend_dae.stepping import runge_kutta
from cartpend_dae.system import System
from cartpend_dae.trouble import trouble_at

Method = Literal["adaptive", "cvodes", "idas", "erk", "rosenbrock", "rk4"]


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
    system = assemble(model)
    _check_method(method, step, {"rtol": rtol, "atol": atol})
    grid = _grid(stop, times, points, step if method == "rk4" else None)
    known = _named("parameters", parameters)
    p = parameter_vector(system, known)
    check_bounds(system, p)
    check_regular(system, p)
    every = checked_inputs(system, _named("inputs", inputs))
    fine = with_knots(grid, every)
    driven = driven_inputs(every, fine)
    u_0 = input_values(driven, fine[:1], driven.left[:, :1])[:, 0]
    found = unknown_parameters(system, known, _named("unknown", unknown))
    begin = initialize(system, p, u_0, _start_values(start), float(grid[0]), unknown=found, steady=steady)
    p = begin.p
    _check_start(system, begin, u_0, p, float(grid[0]))
    _check_frictions(system, begin, u_0, p, float(grid[0]))
    if method == "rk4" and step is not None:
        x, z, modes = _fixed_steps(system, begin, driven, p, fine, step)
    else:
        x, z, modes = _adaptive(system, begin, driven, p, fine, method, rtol, atol)
    units = [system.parameters[system.parameter_index(name)].declaration.unit for name in begin.found]
    return _trajectory(system, fine, grid, x, z, modes, driven, p).with_constants(begin.found, units)


def _check_method(method: str, step: float | None, tolerances: dict[str, float]) -> None:
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


def _grid(
    stop: float | None, times: Sequence[float] | np.ndarray | None, points: int, step: float | None
) -> np.ndarray:
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


def _check_start(system: System, start: Start, u: np.ndarray, p: np.ndarray, time: float) -> None:
    ode, _ = dae(system).rhs(time, start.x, start.z, u, p, np.zeros(system.frictions.force.numel()))
    bad = [name for name, value in zip(system.states, np.asarray(ode).ravel(), strict=True) if not np.isfinite(value)]
    if bad:
        listing = ", ".join(f"`{name}`" for name in bad)
        raise SolverError(
            f"{system.name}: the derivative of {listing} is not finite at the start: a mass, inertia, inductance "
            f"or ratio is zero ({trouble_at(system, time, start.x, start.z, u, p)}). Check the parameters in its "
            f"equation (`cartpend check` prints it)."
        )


def _check_frictions(system: System, start: Start, u: np.ndarray, p: np.ndarray, time: float) -> None:
    """Refuse dry friction whose speed nothing can change, or whose level is negative at the start."""
    f, findings = system.frictions, []
    moving = ca.vertcat(system.x, system.z, system.u, system.time)
    moves = ca.which_depends(f.speed, moving, 1, True) if f.places else []
    arguments = [system.time, system.x, system.z, system.u, system.p, f.force]
    levels = ca.Function("levels", arguments, [f.level_pos, f.level_neg])
    values = levels(time, start.x, start.z, u, p, np.zeros(len(f.places)))
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


def _adaptive(
    system: System,
    start: Start,
    driven: DrivenInputs,
    p: np.ndarray,
    grid: np.ndarray,
    method: Method,
    rtol: float,
    atol: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrate over the grid; return states (n_x, n), algebraics (n_z, n) and friction modes (n_f, n)."""
    hybrid = friction_events(system) if system.frictions.places else None
    n_x, n_f = system.x.numel(), len(system.frictions.places)
    if hybrid is None and n_x == 0:
        return (
            np.zeros((0, grid.size)),
            _algebraic_only(system, start, driven, p, grid),
            np.zeros((0, grid.size)),
        )
    plugin = _plugin(system, method)
    problem, settle = _problem(system, driven, hybrid)
    options: dict[str, Any] = {"reltol": rtol, "abstol": atol, "show_eval_warnings": False}
    if plugin in ("cvodes", "idas"):
        options["max_num_steps"] = 1_000_000
    x_0 = start.x
    if hybrid is not None:
        span = float(grid[-1] - grid[0])
        options |= {"max_step_size": span / 500, "max_events": 100_000, "transition": settle}
        x_0 = np.concatenate([start.x, _start_modes(system, hybrid, start, driven, p, grid)])
    stacked = np.vstack([driven.left, driven.slope, grid[:-1]])
    run = Integration(problem, options, grid, x_0, start.z, p, stacked)
    result, reason = None, ""
    # rosenbrock gives up where rounding makes a resting body's acceleration flicker; erk does not mind
    others = ("erk",) if plugin == "rosenbrock" and method == "adaptive" and not system.z.numel() else ()
    for name in (plugin, *others):
        plugin = name
        result, reason = run.run(name, grid.size)
        if result is not None:
            break
    if result is None:
        raise SolverError(breakdown_sentence(system, run, (plugin, reason), inputs_at(driven, grid)))
    x = np.column_stack([x_0, np.asarray(result["xf"])])
    z = np.column_stack([start.z, np.asarray(result["zf"])]) if start.z.size else np.zeros((0, grid.size))
    return x[:n_x], z, x[n_x:] if n_f else np.zeros((0, grid.size))


def _plugin(system: System, method: Method) -> str:
    if system.frictions.places:
        if method in ("cvodes", "idas"):
            raise ModelError(f"Method `{method}` cannot locate the events of dry friction; use `adaptive`.")
        return "rosenbrock" if method == "adaptive" else method
    if method == "adaptive":
        return "idas" if system.algebraics else "cvodes"
    return method


def _problem(
    system: System, driven: DrivenInputs, hybrid: HybridFriction | None
) -> tuple[dict[str, ca.SX], ca.Function | None]:
    """Return the problem for `casadi.integrator`, with inputs linear in time over each interval."""
    s = system
    n_u = len(s.inputs)
    left, slope, begin = ca.SX.sym("left", n_u), ca.SX.sym("slope", n_u), ca.SX.sym("begin")
    values = left + slope * (s.time - begin)
    for row, expression in driven.expressions.items():
        values[row] = ca.SX(expression(s.time))
    u = ca.vertcat(left, slope, begin)
    ode, alg = s.ode, s.alg
    if hybrid is None:
        ode, alg = _in_inputs([ode, alg], s, values)
        return {"x": s.x, "z": s.z, "p": s.p, "u": u, "t": s.time, "ode": ode, "alg": alg}, None
    ode, alg = ca.substitute([ode, alg], [s.frictions.force], [hybrid.force])
    x = ca.vertcat(s.x, hybrid.modes)
    ode = ca.vertcat(ode, ca.SX.zeros(hybrid.modes.numel()))
    ode, alg, indicators = _in_inputs([ode, alg, hybrid.indicators], s, values)
    fired = ca.SX.sym("fired")
    settled = hybrid.settle(s.time, s.x, hybrid.modes, s.z, values, s.p)
    transition = ca.Function(
        "transition",
        [fired, s.time, x, s.z, s.p, u],
        [ca.vertcat(*settled), s.z],
        ca.event_in(),
        ca.event_out(),
    )
    problem = {"x": x, "z": s.z, "p": s.p, "u": u, "t": s.time, "ode": ode, "alg": alg, "zero": indicators}
    return problem, transition


def _in_inputs(expressions: list[ca.SX], system: System, values: ca.SX) -> list[ca.SX]:
    return list(ca.substitute(expressions, [system.u], [values])) if len(system.inputs) else expressions


def _start_modes(
    system: System, hybrid: HybridFriction, start: Start, driven: DrivenInputs, p: np.ndarray, grid: np.ndarray
) -> np.ndarray:
    u = input_values(driven, grid[:1], driven.left[:, :1])[:, 0]
    speed = ca.Function("speed", [system.time, system.x, system.z, system.u, system.p], [system.frictions.speed])
    signs = np.sign(np.asarray(speed(grid[0], start.x, start.z, u, p)).ravel())
    _, modes = hybrid.settle(grid[0], start.x, signs, start.z, u, p)
    return np.asarray(modes).ravel()


def _algebraic_only(system: System, start: Start, driven: DrivenInputs, p: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Solve a model without states at each output time."""
    return algebraics_along(system, start, p, inputs_at(driven, grid), grid)


def _fixed_steps(
    system: System, start: Start, driven: DrivenInputs, p: np.ndarray, grid: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Step over the grid, divided into steps no longer than `step`; return the same as `_adaptive`."""
    times, inputs, where = refined(driven, grid, step)
    widths = np.diff(times)
    left = input_values(inputs, times[:-1], inputs.left)
    right = input_values(inputs, times[1:], inputs.left + inputs.slope * widths)
    run = runge_kutta(system).function.mapaccum("run", widths.size, ["x"], ["x_next"])
    result = run(t=times[:-1], h=widths, x=start.x, u_a=left, u_b=right, p=np.tile(p[:, None], widths.size))
    x = np.column_stack([start.x, np.asarray(result["x_next"])])
    if not np.all(np.isfinite(x)):
        first = times[int(np.flatnonzero(~np.isfinite(x).all(axis=0))[0])]
        raise SolverError(
            f"{system.name}: rk4 with step {step:g} s is unstable: not finite from {first:g} s on; use a smaller step."
        )
    return x[:, where], np.zeros((0, grid.size)), np.zeros((0, grid.size))


def _trajectory(
    system: System,
    fine: np.ndarray,
    grid: np.ndarray,
    x: np.ndarray,
    z: np.ndarray,
    modes: np.ndarray,
    driven: DrivenInputs,
    p: np.ndarray,
) -> Trajectory:
    keep = np.searchsorted(fine, grid)
    u = inputs_at(driven, fine)[:, keep]
    force = _forces(system, grid, x[:, keep], z[:, keep], u, p, modes[:, keep])
    return Trajectory(
        time=grid,
        names=tuple(variable.name for variable in system.variables),
        values=all_variables(system, grid, x[:, keep], z[:, keep], u, p, force),
        units=tuple(variable.declaration.unit for variable in system.variables),
    )


def _forces(
    system: System,
    grid: np.ndarray,
    x: np.ndarray,
    z: np.ndarray,
    u: np.ndarray,
    p: np.ndarray,
    modes: np.ndarray,
) -> np.ndarray:
    """Return the friction forces at the output times, shape (n_f, n)."""
    n_f = len(system.frictions.places)
    if not n_f:
        return np.zeros((0, grid.size))
    hybrid = friction_events(system)
    arguments = [system.time, system.x, hybrid.modes, system.z, system.u, system.p]
    columns = np.tile(p[:, None], grid.size)
    if not modes.size:
        speed = ca.Function("speed", [*arguments[:2], *arguments[3:]], [system.frictions.speed]).map(grid.size)
        speeds = np.asarray(speed(grid[None, :], x, z, u, columns))
        modes = np.where(np.abs(speeds) > 1e-9 * np.abs(speeds).max(initial=0.0), np.sign(speeds), 0.0)
    force = ca.Function("force", arguments, [hybrid.force]).map(grid.size)
    return np.asarray(force(grid[None, :], x, modes, z, u, columns))
