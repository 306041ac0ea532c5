"""From a consistent start through all events to the states at the output times, by CasADi's integrators."""

import contextlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal

import casadi as ca
import numpy as np

from cartpend_dae.dae import all_variables
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.events import CHATTER, Machine, initial_memory, machine
from cartpend_dae.initialize import Start, algebraics_along
from cartpend_dae.inputs import DrivenInputs, inputs_at
from cartpend_dae.system import System

Method = Literal["adaptive", "cvodes", "idas", "erk", "rosenbrock", "rk4"]
MOST_EVENTS = 1_000_000


@dataclass(frozen=True, slots=True)
class Choice:
    """An integrator and its tolerances."""

    method: Method
    rtol: float
    atol: float


@dataclass(frozen=True, slots=True)
class Begin:
    """A system where it starts: states (n_x,), algebraic variables (n_z,), parameters and, with events, memory."""

    system: System
    machine: Machine | None
    x: np.ndarray
    z: np.ndarray
    p: np.ndarray
    found: Mapping[str, float]
    memory: np.ndarray

    @property
    def between(self) -> System:
        """The system between events."""
        return self.machine.system if self.machine is not None else self.system

    def inputs(self, u: np.ndarray, memory: np.ndarray | None = None) -> np.ndarray:
        """Return the inputs of the system between events, from its own inputs (n_u, n) or (n_u,) and the memory."""
        if self.machine is None:
            return u
        return np.concatenate([u, given_of(self.machine, self.memory if memory is None else memory)])


@dataclass(frozen=True, slots=True)
class Run:
    """States (n_x, n), algebraic variables (n_z, n) and, with events, memory (n_m, n) over a grid."""

    x: np.ndarray
    z: np.ndarray
    memory: np.ndarray | None


def given_of(made: Machine, memory: np.ndarray) -> np.ndarray:
    """Return what the memory gives to the system between events: discrete variables, relations, and no pulses."""
    parts = made.memory.split(memory)
    pulses = np.zeros((made.memory.next.numel(), *memory.shape[1:]))
    return np.concatenate([parts["discretes"], np.round(parts["relations"]), pulses])


def started(system: System, p: np.ndarray, u: np.ndarray, initialize: Callable[..., Start], grid: np.ndarray) -> Begin:
    """Find a consistent start, with relations and modes that fit it.

    Parameters
    ----------
    system, p, u
        The system, its parameters (n_p,) and inputs at the start (n_u,).
    initialize
        The search for a start of a system without events, given system, p and u.
    grid
        All times of the run [s].

    Raises
    ------
    SolverError
        If there is none, or if relations at the start go round in circles.
    """
    if system.hybrid.is_empty and not system.frictions.places:
        start = initialize(system, p, u)
        return Begin(system, None, start.x, start.z, start.p, start.found, np.zeros(0))
    time, span = float(grid[0]), float(grid[-1] - grid[0])
    made, h = machine(system, span), system.hybrid
    memory = initial_memory(made, system, time, u, p)
    s, parts = made.system, made.memory
    names = [s.time, s.x, s.z, s.u, s.p, s.frictions.force]
    decide = ca.Function("decide", names, [h.differences < 0, s.frictions.speed, h.conditions])
    n_f, n_d, n_r = parts.modes.numel(), parts.discretes.numel(), parts.relations.numel()
    where = slice(n_f + n_d, n_f + n_d + n_r)
    for _ in range(20):
        given = np.concatenate([u, given_of(made, memory)])
        start = initialize(s, p, given)
        decided = decide(time, start.x, start.z, given, start.p, np.zeros(n_f))
        relations, speeds, held = (np.asarray(value, dtype=float).ravel() for value in decided)
        if np.array_equal(relations, memory[where]):
            break
        memory[where] = relations
    else:
        listing = ", ".join(sorted({f"`{place}`" for place in h.relation_places}))
        raise SolverError(
            f"{system.name}: no start fits the conditions of {listing}: each start that is tried makes others true."
        )
    memory[:n_f] = np.sign(np.where(np.abs(speeds) > 1e-9, speeds, 0.0))
    memory[where.stop : where.stop + held.size] = held
    x, settled = made.settle(time, start.x, memory, start.z, u, start.p)
    return Begin(system, made, np.asarray(x).ravel(), start.z, start.p, start.found, np.asarray(settled).ravel())


def integrate(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> Run:
    """Integrate over a grid.

    Parameters
    ----------
    begin
        The start.
    driven
        Inputs over the intervals of the grid.
    grid
        Times (n,) [s].
    choice
        Integrator and tolerances.

    Raises
    ------
    ModelError
        For an integrator that cannot locate events.
    SolverError
        If the integration fails, or a condition of the model ends it.
    """
    system, made = begin.between, begin.machine
    if made is None and system.x.numel() == 0:
        z = algebraics_along(system, Start(begin.x, begin.z, begin.p, {}), begin.p, inputs_at(driven, grid), grid)
        return Run(np.zeros((0, grid.size)), z, None)
    options: dict[str, Any] = {"reltol": choice.rtol, "abstol": choice.atol, "show_eval_warnings": False}
    problem, transition = _problem(begin.system, made, driven)
    if transition is not None:
        span = float(grid[-1] - grid[0])
        # after an event an indicator counts only above `event_tol`: with its default of 1e-6 close events are lost
        options |= {"max_step_size": span / 500, "max_events": MOST_EVENTS, "transition": transition, "event_tol": 0.0}
    stacked = np.vstack([driven.left, driven.slope, grid[:-1]])
    reason, plugins = "", _plugins(begin, choice.method)
    for plugin in plugins:
        extra = {"max_num_steps": 1_000_000} if plugin in ("cvodes", "idas") else {}
        try:
            with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
                x, z = _piecewise(plugin, problem, begin, (driven, stacked), grid, options | extra)
            break
        except RuntimeError as error:
            reason = str(error)
    else:
        raise SolverError(_failure(system, plugins[0], reason, grid))
    if not np.all(np.isfinite(x)):
        raise SolverError(_failure(system, plugins[0], "a state is not finite", grid))
    run = Run(x[: begin.x.size], z, None if made is None else x[begin.x.size :])
    _check_end(begin, run)
    return run


def _piecewise(
    plugin: str,
    problem: dict[str, ca.SX],
    begin: Begin,
    inputs: tuple[DrivenInputs, np.ndarray],
    grid: np.ndarray,
    options: dict[str, Any],
) -> tuple[np.ndarray, np.ndarray]:
    """Return states and algebraic variables over the grid.

    Where an input jumps, the integrator starts anew: what it has learned of the past misleads it there. So do the
    decisions on modes and relations: an indicator that a jump takes below zero never falls through it.

    Parameters
    ----------
    plugin, problem, options
        For `casadi.integrator`.
    begin
        The start.
    inputs
        Inputs over the intervals; also as one array of their values at the left end, slopes and beginning of each.
    grid
        Times (n,) [s].
    """
    (driven, stacked), made, z, p = inputs, begin.machine, begin.z, begin.p
    x = np.concatenate([begin.x, begin.memory])
    u, n_x = inputs_at(driven, grid), begin.x.size
    ends = [0, *_jumps(driven, grid), grid.size - 1]
    columns_x, columns_z = [x[:, None]], [z[:, None]]
    for first, last in pairwise(ends):
        if first and made is not None:
            settled = made.settle(grid[first], x[:n_x], x[n_x:], z, u[:, first], p)
            x = np.concatenate([np.asarray(part).ravel() for part in settled])
        # a piece after a jump begins with an output of its own: the algebraic variables jump too
        outputs = np.arange(first, last + 1) if first else np.arange(1, last + 1)
        integrator = ca.integrator("run", plugin, problem, float(grid[first]), grid[outputs].tolist(), options)
        result = integrator(x0=x, z0=z, p=p, u=stacked[:, np.maximum(outputs - 1, first)])
        x_piece, z_piece = np.asarray(result["xf"]), np.asarray(result["zf"]).reshape(z.size, outputs.size)
        if first:
            columns_x[-1], columns_z[-1] = columns_x[-1][:, :-1], columns_z[-1][:, :-1]
        columns_x.append(x_piece)
        columns_z.append(z_piece)
        x, z = x_piece[:, -1], z_piece[:, -1]
    return np.hstack(columns_x), np.hstack(columns_z)


def _jumps(driven: DrivenInputs, grid: np.ndarray) -> list[int]:
    """Return the points of the grid, other than its ends, at which an input jumps by more than rounding."""
    arrived = driven.left[:, :-1] + driven.slope[:, :-1] * np.diff(grid)[:-1]
    size = 1e-9 * np.abs(driven.left).max(axis=1, keepdims=True, initial=0.0)
    return [int(k) + 1 for k in np.flatnonzero((np.abs(driven.left[:, 1:] - arrived) > size).any(axis=0))]


def _plugins(begin: Begin, method: Method) -> tuple[str, ...]:
    if begin.machine is not None:
        if method in ("cvodes", "idas"):
            what = "dry friction" if begin.system.hybrid.is_empty else "the model"
            raise ModelError(f"Method `{method}` cannot locate the events of {what}; use `adaptive`.")
        if method != "adaptive":
            return (method,)
        # rosenbrock gives up where rounding makes a resting body's acceleration flicker; erk does not mind
        return ("rosenbrock",) if begin.z.size else ("rosenbrock", "erk")
    if method == "adaptive":
        return ("idas",) if begin.system.algebraics else ("cvodes",)
    return (method,)


def _problem(system: System, made: Machine | None, driven: DrivenInputs) -> tuple[dict[str, ca.SX], ca.Function | None]:
    """Return the problem for `casadi.integrator`, with inputs linear in time over each interval."""
    s = system
    n_u = len(s.inputs)
    left, slope, begin = ca.SX.sym("left", n_u), ca.SX.sym("slope", n_u), ca.SX.sym("begin")
    values = left + slope * (s.time - begin)
    for row, expression in driven.expressions.items():
        values[row] = ca.SX(expression(s.time))
    u = ca.vertcat(left, slope, begin)
    if made is None:
        ode, alg = _replaced([s.ode, s.alg], [(s.u, values)])
        return {"x": s.x, "z": s.z, "p": s.p, "u": u, "t": s.time, "ode": ode, "alg": alg}, None
    memory, pulses = made.memory, s.hybrid.pulses
    whole = memory.whole
    old = [(s.frictions.force, made.force), (pulses, ca.SX.zeros(pulses.numel()))]
    old += [(s.hybrid.relations, whole.relations), (s.u, values)]
    ode, alg = s.ode, s.alg
    for pair in old:
        ode, alg = _replaced([ode, alg], [pair])
    (indicators,) = _replaced([made.indicators], [(s.u, values)])
    x = ca.vertcat(s.x, memory.vector)
    runs = whole.note[0] == 0
    ode = ca.vertcat(ca.if_else(runs, ode, 0), ca.SX.zeros(memory.vector.numel()))
    problem = {"x": x, "z": s.z, "p": s.p, "u": u, "t": s.time, "ode": ode, "alg": alg, "zero": indicators}
    return problem, _transition(s, made, u, values)


def _transition(s: System, made: Machine, u: ca.SX, values: ca.SX) -> ca.Function:
    """Return what happens at an event in the form that CasADi's integrators ask for."""
    inputs = ca.Function("inputs", [s.time, u], [values])
    n_x, n_m = s.x.numel(), made.memory.vector.numel()
    fired, time, x = ca.MX.sym("fired"), ca.MX.sym("t"), ca.MX.sym("x", n_x + n_m)
    z, p, packed = ca.MX.sym("z", s.z.numel()), ca.MX.sym("p", s.p.numel()), ca.MX.sym("u", u.numel())
    new_x, new_m = made.settle(time, x[:n_x], x[n_x:], z, inputs(time, packed), p)
    after = [ca.vertcat(new_x, new_m), z]
    return ca.Function("transition", [fired, time, x, z, p, packed], after, ca.event_in(), ca.event_out())


def _replaced(expressions: list[ca.SX], pairs: list[tuple[ca.SX, ca.SX]]) -> list[ca.SX]:
    pairs = [pair for pair in pairs if pair[0].numel()]
    if not pairs:
        return expressions
    return list(ca.substitute(expressions, [old for old, _ in pairs], [new for _, new in pairs]))


def _check_end(begin: Begin, run: Run) -> None:
    """Refuse a run that events stopped, with the reason."""
    if begin.machine is None or run.memory is None:
        return
    reason, time = begin.machine.memory.split(run.memory[:, -1])["note"][:2]
    if not round(reason):
        return
    h, name = begin.system.hybrid, begin.system.name
    if reason > 0:
        action = h.actions[round(reason) - 1]
        raise SolverError(f"{name} ends at {time:.6g} s by `{action.place}`: {action.sentence}")
    places = ", ".join(sorted({f"`{place}`" for place in (*h.relation_places, *begin.system.frictions.places)}))
    if reason == CHATTER:
        raise SolverError(
            f"{name}: at {time:.6g} s the decisions of {places} go round in circles: each makes another one untrue. "
            f"Give a condition a width (two thresholds), or what they drive some inertia."
        )
    raise SolverError(
        f"{name}: events of {places} follow each other without end at {time:.6g} s. Let what bounces come to rest "
        f"below a small speed, or give what switches a width (two thresholds)."
    )


def _failure(system: System, plugin: str, reason: str, grid: np.ndarray) -> str:
    tail = reason.strip().splitlines()[-1][:200] if reason.strip() else "no reason given"
    return (
        f"{system.name}: {plugin} could not integrate from {grid[0]:g} s to {grid[-1]:g} s ({tail}). "
        f"Look for a state that runs away, a division by zero or a discontinuity; try `rtol`, or `method`."
    )


def trajectory(begin: Begin, run: Run, driven: DrivenInputs, fine: np.ndarray, grid: np.ndarray) -> Trajectory:
    """Return all variables at the output times `grid` of a run over `fine`."""
    system, p = begin.between, begin.p
    keep = np.searchsorted(fine, grid)
    u = inputs_at(driven, fine)[:, keep]
    x, z = run.x[:, keep], run.z[:, keep]
    memory = None if run.memory is None else run.memory[:, keep]
    if begin.machine is not None:
        u = begin.inputs(u, np.tile(begin.memory[:, None], grid.size) if memory is None else memory)
    return Trajectory(
        time=grid,
        names=tuple(variable.name for variable in system.variables),
        values=all_variables(system, grid, x, z, u, p, _forces(begin, grid, x, z, u, memory)),
        units=tuple(variable.declaration.unit for variable in system.variables),
    )


def _forces(
    begin: Begin, grid: np.ndarray, x: np.ndarray, z: np.ndarray, u: np.ndarray, memory: np.ndarray | None
) -> np.ndarray:
    """Return the friction forces at the output times, shape (n_f, n)."""
    system, made = begin.between, begin.machine
    n_f = len(system.frictions.places)
    if not n_f or made is None:
        return np.zeros((0, grid.size))
    columns = np.tile(begin.p[:, None], grid.size)
    arguments = [system.time, system.x, system.z, system.u, system.p]
    if memory is not None:
        modes = np.round(made.memory.split(memory)["modes"])
    else:
        speed = ca.Function("speed", arguments, [system.frictions.speed]).map(grid.size)
        speeds = np.asarray(speed(grid[None, :], x, z, u, columns))
        modes = np.where(np.abs(speeds) > 1e-9 * np.abs(speeds).max(initial=0.0), np.sign(speeds), 0.0)
    force = ca.Function("force", [*arguments, made.memory.modes], [made.force]).map(grid.size)
    return np.asarray(force(grid[None, :], x, z, u, columns, modes))
