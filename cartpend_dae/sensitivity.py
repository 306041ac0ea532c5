"""Exact derivatives of a simulation in parameters and start values, through all its events.

CasADi's integrators `erk` and `rosenbrock` differentiate their own steps, the instants of events and what happens
there. Memory between events (modes, relations, clocks) is piecewise constant, so that it adds nothing; discrete
variables are carried along. The start follows from the conditions that determine it (implicit function theorem), and
algebraic variables from their equations.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.begin import Begin
from cartpend_dae.coincidence import coincidence
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.hybrid_problem import replaced
from cartpend_dae.inputs import Input, input_values, inputs_at, jumps_of
from cartpend_dae.integrate import Run, Solved, solved
from cartpend_dae.language import Component
from cartpend_dae.plugins import Choice, Method
from cartpend_dae.simulate import Asked, Ready, check_method, output_grid, prepared_run
from cartpend_dae.start_slopes import KeepingSearch, settle_slopes, start_slopes
from cartpend_dae.system import System

T = TypeVar("T")

# Newton steps for algebraic variables after the jump of an input; elsewhere they stand already
MOST_NEWTON = 20


@dataclass(frozen=True, slots=True)
class Sensitivities:
    """Outputs of a run, `values` (n_times, n_outputs), and their `slopes` (n_times, n_outputs, n_names), SI units.

    `names` are the parameters, and the variables whose start values were changed. At the very instant of an event
    that makes an output jump, the slopes are those of the side whose value is shown.
    """

    times: np.ndarray
    outputs: tuple[str, ...]
    names: tuple[str, ...]
    values: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True, slots=True)
class Gradient:
    """A weighted sum of outputs, and its `slopes` (n_names,) in what `names` says, SI units."""

    names: tuple[str, ...]
    value: float
    slopes: np.ndarray


@dataclass(frozen=True, slots=True)
class _Linear:
    """A run with the local derivatives that make up its sensitivities.

    A state here holds states and memory, X (n_X,). `start` is dX/d(names) (n_X, n) and `given` dp/d(names) (n_p, n) of
    the start; at the output times `in_state` (n_times, n_outputs, n_X) and `in_p` (n_times, n_outputs, n_p). `keep`
    are the output times in the grid, `jumps` the derivatives in X and p of what is decided after an input has jumped.
    """

    system: System
    found: Solved
    names: tuple[str, ...]
    start: np.ndarray
    given: np.ndarray
    values: np.ndarray
    in_state: np.ndarray
    in_p: np.ndarray
    keep: np.ndarray
    jumps: dict[int, tuple[np.ndarray, np.ndarray]]


def sensitivities(
    model: Component | System,
    parameters: Sequence[str],
    *,
    times: Sequence[float] | np.ndarray,
    outputs: Sequence[str],
    inputs: Mapping[str, Input] | None = None,
    start: Mapping[str, float] | None = None,
    values: Mapping[str, float] | None = None,
    method: Method = "adaptive",
    rtol: float = 1e-9,
    atol: float = 1e-11,
) -> Sensitivities:
    """Simulate a model and differentiate its outputs exactly, through all events.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    parameters
        Names of parameters, and of variables in `start`: by their values the outputs are differentiated.
    times
        Output times [s], strictly increasing; the first is the start.
    outputs
        Names of variables.
    inputs, start
        As `simulate` takes them.
    values
        Values of parameters by name, as the `parameters` of `simulate`.
    method
        `adaptive`, `erk` or `rosenbrock`; the other integrators differentiate wrongly through events, or not at all.
    rtol, atol
        Relative and absolute tolerance of the integrator.

    Raises
    ------
    ModelError
        As `simulate`, and for a name by which nothing can be differentiated.
    SolverError
        As `simulate`, and where there is no derivative: a condition that is touched and not crossed, say.
    """
    grid = output_grid(None, times, 0, None)
    asked, choice = Asked(inputs, start, values), Choice(method, rtol, atol, is_differentiated=True)
    line = _linear(assemble(model), tuple(parameters), tuple(outputs), (grid, asked, choice))
    states = _states_slopes(line)
    slopes = np.einsum("kyx,xkn->kyn", line.in_state, states) + line.in_p @ line.given
    _check_finite(slopes, line)
    return Sensitivities(grid, tuple(outputs), line.names, line.values, slopes)


def gradient(
    model: Component | System,
    parameters: Sequence[str],
    *,
    times: Sequence[float] | np.ndarray,
    outputs: Sequence[str],
    weights: np.ndarray,
    inputs: Mapping[str, Input] | None = None,
    start: Mapping[str, float] | None = None,
    values: Mapping[str, float] | None = None,
    method: Method = "adaptive",
    rtol: float = 1e-9,
    atol: float = 1e-11,
) -> Gradient:
    """Differentiate a weighted sum of outputs by one run backwards (adjoint), whatever the number of parameters.

    Parameters
    ----------
    weights
        Of each output at each time, shape (n_times, n_outputs).
    model, parameters, times, outputs, inputs, start, values, method, rtol, atol
        As `sensitivities` takes them.

    Raises
    ------
    ModelError, SolverError
        As `sensitivities`, and for weights of another shape.
    """
    grid, factors = output_grid(None, times, 0, None), np.asarray(weights, dtype=float)
    shape = (grid.size, len(outputs))
    if factors.shape != shape:
        raise ModelError(
            f"`weights` must have a row for each time and a column for each output: {shape}, not {factors.shape}."
        )
    asked, choice = Asked(inputs, start, values), Choice(method, rtol, atol, is_differentiated=True)
    line = _linear(assemble(model), tuple(parameters), tuple(outputs), (grid, asked, choice))
    in_state = np.einsum("kyx,ky->kx", line.in_state, factors)
    in_p = np.einsum("kyp,ky->p", line.in_p, factors)
    slopes = line.given.T @ in_p
    if (whole := line.found.whole) is not None:
        seeds, n = np.zeros((whole.x.size, whole.grid.size)), line.start.shape[0]
        for k, at in enumerate(line.keep):
            row = in_state[k]
            if at in line.jumps:
                slopes, row = slopes + line.given.T @ (line.jumps[at][1].T @ row), line.jumps[at][0].T @ row
            seeds[:n, at] = row
        in_start, by_p = _derived(line, lambda: whole.reverse(line.found.plugin, seeds[:, 1:]))
        slopes = slopes + line.start.T @ (in_start[:n] + seeds[:n, 0]) + line.given.T @ by_p
    _check_finite(slopes[None, None], line)
    return Gradient(line.names, float(np.sum(factors * line.values)), slopes)


def _derived(line: _Linear, derive: Callable[[], T]) -> T:
    try:
        return derive()
    except RuntimeError as error:
        raise SolverError(
            f"{line.system.name} cannot be differentiated along its simulation ({str(error)[:200]}): its derivatives "
            f"diverge, or an event passes by too slowly. Simulate a shorter time."
        ) from None


def _check_finite(slopes: np.ndarray, line: _Linear) -> None:
    bad = sorted({line.names[k] for k in np.flatnonzero(~np.isfinite(slopes).all(axis=(0, 1)))})
    if bad:
        raise SolverError(
            f"{line.system.name} has no derivatives in {', '.join(f'`{name}`' for name in bad)}: at some event a "
            f"condition is touched, not crossed, or a derivative of the equations is infinite. Change a start value "
            f"or an input a little."
        )


def _linear(
    system: System, names: tuple[str, ...], outputs: tuple[str, ...], run: tuple[np.ndarray, Asked, Choice]
) -> _Linear:
    """Simulate, and differentiate what stands at the start, at the output times and where inputs jump there."""
    grid, asked, choice = run
    check_method(choice.method, None, {"rtol": choice.rtol, "atol": choice.atol})
    if choice.method not in ("adaptive", "erk", "rosenbrock"):
        raise ModelError(
            f"Method `{choice.method}` does not differentiate through events: choose `adaptive`, `erk` or `rosenbrock`."
        )
    _check_names(system, names, dict(asked.start or {}))
    moved = [system.parameter_index(name) for name in names if name not in (asked.start or {})]
    search = KeepingSearch()
    ready = prepared_run(system, grid, asked, search=search, with_times=not _moves_times(system, moved))
    begin, driven, fine = ready.begin, ready.driven, ready.fine
    found = solved(begin, driven, fine, choice)
    u = inputs_at(driven, fine)
    start = start_slopes(begin, search, names, input_values(driven, fine[:1], driven.left[:, :1])[:, 0])
    _check_coincidence(begin, found, start.parameters)
    keep = np.searchsorted(fine, grid)
    at = _local(begin, outputs, fine[keep], found.run, keep, u[:, keep])
    jumps = _jumps(ready, found.left, keep, u)
    return _Linear(system, found, names, start.state, start.parameters, *at, keep, jumps)


def _check_names(system: System, names: Sequence[str], start: Mapping[str, float]) -> None:
    """Refuse what nothing can be differentiated by."""
    if len(set(names)) < len(names):
        raise ModelError(f"A name stands twice among the parameters: {', '.join(f'`{name}`' for name in names)}.")
    for name in names:
        if name in start:
            continue
        if name in system.positions[0]:
            raise ModelError(
                f"`{name}` is a variable of {system.name} without a start value: give `start={{'{name}': ...}}` to "
                f"differentiate by it."
            )
        if system.parameters[system.parameter_index(name)].is_built_as_zero:
            raise ModelError(
                f"`{name}` was 0 when the model was built, so that the part it belongs to does not exist, and nothing "
                f"is differentiated by it; set it in the constructor."
            )


def _moves_times(system: System, moved: Sequence[int]) -> bool:
    """Tell whether parameters move events that time alone decides: these are located in the run then, not before it."""
    h = system.hybrid
    if not (moved and h.relation_places):
        return False
    is_moved = ca.which_depends(h.differences, system.p[list(moved), 0], 1, True)
    for k in np.flatnonzero(is_moved).tolist():
        function = ca.Function("difference", [ca.vertcat(*ca.symvar(h.differences[k]))], [h.differences[k]])
        operations = {function.instruction_id(i) for i in range(function.n_instructions())}
        if operations & {ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD, ca.OP_SIGN}:
            names = ", ".join(f"`{system.parameters[i].name}`" for i in moved)
            raise ModelError(
                f"{system.name}: the condition in `{h.relation_places[k]}` jumps, where it repeats itself, at times "
                f"that {names} may move: CasADi differentiates events that are crossed only. Leave this parameter out."
            )
    return bool(any(is_moved))


def _check_coincidence(begin: Begin, found: Solved, directions: np.ndarray) -> None:
    """Refuse a run in which two events meet whose instants a parameter moves apart."""
    if begin.machine is None or found.whole is None:
        return
    meeting = coincidence(found.whole, found.plugin, directions)
    if meeting is None:
        return
    places = begin.machine.places
    listing = " and ".join(f"`{places[k]}`" for k in meeting.indicators if k < len(places))
    raise ModelError(
        f"{begin.system.name}: at {meeting.time:.6g} s events of {listing} meet, each with an instant of "
        f"its own, and CasADi differentiates only one of them. Change a start value or a parameter a little."
    )


def _local(
    begin: Begin, outputs: tuple[str, ...], times: np.ndarray, run: Run, keep: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return outputs (n, n_y) and their derivatives in states and memory (n, n_y, n_X) and parameters (n, n_y, n_p)."""
    function = _local_function(begin, outputs)
    memory = np.zeros((0, times.size)) if run.memory is None else run.memory[:, keep]
    found = [
        _local_at(function, (time, run.x[:, i], memory[:, k]), run.z[:, i], (u[:, k], begin.p))
        for k, (time, i) in enumerate(zip(times.tolist(), keep.tolist(), strict=True))
    ]
    values, in_state, in_p = (np.array(part) for part in zip(*found, strict=True))
    return values, in_state, in_p


def _local_at(function: ca.Function, state: tuple, z: np.ndarray, given: tuple) -> tuple[np.ndarray, ...]:
    """Return outputs and their derivatives at one time, along the solution z of the algebraic equations."""
    left = MOST_NEWTON
    while True:
        y, y_state, y_z, y_p, *equations = (np.asarray(part) for part in function(*state, z, *given))
        if not z.size:
            return y.ravel(), y_state, y_p
        residual, by_state, by_z, by_p = equations
        step = np.linalg.solve(by_z, residual).ravel()
        if np.all(np.abs(step) <= 1e-12 * (1e-3 + np.abs(z))) or not left:
            break
        z, left = z - step, left - 1
    return y.ravel(), y_state - y_z @ np.linalg.solve(by_z, by_state), y_p - y_z @ np.linalg.solve(by_z, by_p)


def _local_function(begin: Begin, outputs: tuple[str, ...]) -> ca.Function:
    """Return (t, x, memory, z, u, p) -> outputs and equations of z, each with its derivatives in (x, memory), z, p."""
    s, made = begin.between, begin.machine
    expressions, memory = [s.outputs[[s.index_of(name) for name in outputs], 0], s.alg], ca.SX(0, 1)
    if made is not None:
        memory, h = made.memory.vector, begin.system.hybrid
        for pair in ((s.frictions.force, made.force), (h.pulses, ca.SX.zeros(h.pulses.numel()))):
            expressions = replaced(expressions, [pair])
    state, blocks = ca.vertcat(s.x, memory), []
    for expression in expressions:
        blocks += [expression, *(ca.densify(ca.jacobian(expression, by)) for by in (state, s.z, s.p))]
    return ca.Function("local", [s.time, s.x, memory, s.z, begin.system.u, s.p], blocks)


def _jumps(ready: Ready, left: Run, keep: np.ndarray, u: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return how what is decided at output times, after an input has jumped, follows from states, memory and p."""
    begin, made, found = ready.begin, ready.begin.machine, {}
    if made is None or left.memory is None:
        return found
    for k in np.intersect1d(np.flatnonzero(jumps_of(ready.driven, ready.fine)), keep).tolist():
        point = left.x[:, k], left.memory[:, k], left.z[:, k], u[:, k], begin.p
        by_state, by_z, by_p = settle_slopes(begin.system, made, float(ready.fine[k]), *point)
        if np.any(by_z[: left.x.shape[0]]):
            raise ModelError(
                f"{begin.system.name}: at {ready.fine[k]:g} s, an output time, an input jumps, and a state with it to "
                f"what algebraic variables say: this is not differentiated. Choose another output time."
            )
        found[k] = by_state, by_p
    return found


def _states_slopes(line: _Linear) -> np.ndarray:
    """Return the derivatives of states and memory at the output times, shape (n_X, n_times, n_names)."""
    whole, n = line.found.whole, line.start.shape[0]
    if whole is None:
        return np.zeros((n, line.keep.size, len(line.names)))
    dx = np.vstack([line.start, np.zeros((whole.x.size - n, len(line.names)))])
    later = _derived(line, lambda: whole.forward(line.found.plugin, dx, line.given))
    slopes = np.concatenate([dx[:, None], later], axis=1)[:n, line.keep]
    for k, at in enumerate(line.keep.tolist()):
        if at in line.jumps:
            by_state, by_p = line.jumps[at]
            slopes[:, k] = by_state @ slopes[:, k] + by_p @ line.given
    return slopes
