"""From a consistent start through all events to the states at the output times, by CasADi's integrators."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from cartpend_dae.breakdown import breakdown_sentence
from cartpend_dae.dae import all_variables
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError, SolverError
from cartpend_dae.events import CHATTER, Machine, initial_memory, machine
from cartpend_dae.initialize import Start, algebraics_along
from cartpend_dae.inputs import DrivenInputs, inputs_at
from cartpend_dae.integration import Integration
from cartpend_dae.system import System

Method = Literal["adaptive", "cvodes", "idas", "erk", "rosenbrock", "rk4"]
MOST_EVENTS = 1_000_000
# erk is stable up to steps of about this over the fastest rate; beyond so many steps the implicit method is faster,
# which errs more often at events: the acceleration of a body at rest flickers by rounding
STABLE, MOST_STEPS = 3.3, 300_000
# compiled, an explicit step costs a quarter of an implicit one, of which a few thousand are enough
FEW_STEPS = 20_000


@dataclass(frozen=True, slots=True)
class Choice:
    """An integrator and its tolerances."""

    method: Method
    rtol: float
    atol: float
    is_compiled: bool = False


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
    x_0 = np.concatenate([begin.x, begin.memory])
    options: dict[str, Any] = {"reltol": choice.rtol, "abstol": choice.atol, "show_eval_warnings": False}
    problem, transition, stacked = _problem(begin.system, made, driven, grid)
    span = float(grid[-1] - grid[0])
    if ca.depends_on(ca.vertcat(problem["ode"], problem["alg"]), problem["t"]):
        options["max_step_size"] = span / 500  # what time does to a model at rest, a long step would pass over
    if transition is not None:
        # after an event an indicator counts only above `event_tol`: with its default of 1e-6 close events are lost
        options |= {"max_step_size": span / 500, "max_events": MOST_EVENTS, "transition": transition, "event_tol": 0.0}
    whole = Integration(problem, options, grid, x_0, begin.z, begin.p, stacked, choice.is_compiled)
    plugin, result, reason = "", None, ""
    for plugin in _plugins(begin, driven, grid, choice):
        result, reason = whole.run(plugin, grid.size)
        if result is not None:
            break
    if result is None:
        u = begin.inputs(inputs_at(driven, grid), np.tile(begin.memory[:, None], grid.size))
        raise SolverError(breakdown_sentence(system, whole, (plugin, reason), u))
    x = np.column_stack([x_0, np.asarray(result["xf"])])
    z = np.column_stack([begin.z, np.asarray(result["zf"])]) if begin.z.size else np.zeros((0, grid.size))
    run = Run(x[: begin.x.size], z, None if made is None else x[begin.x.size :])
    _check_end(begin, run)
    return run


def _plugins(begin: Begin, driven: DrivenInputs, grid: np.ndarray, choice: Choice) -> tuple[str, ...]:
    method = choice.method
    if begin.machine is not None:
        if method in ("cvodes", "idas"):
            what = "dry friction" if begin.system.hybrid.is_empty else "the model"
            raise ModelError(f"Method `{method}` cannot locate the events of {what}; use `adaptive`.")
        if method != "adaptive":
            return (method,)
        if begin.z.size:
            return ("rosenbrock",)
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        return ("erk", "rosenbrock") if n_steps < MOST_STEPS else ("rosenbrock", "erk")
    if method != "adaptive":
        return (method,)
    if choice.is_compiled:  # cvodes and idas cannot be
        n_steps = _fastest_rate(begin, driven, grid) * float(grid[-1] - grid[0]) / STABLE
        return ("erk",) if n_steps < FEW_STEPS and not begin.z.size else ("rosenbrock",)
    return ("idas",) if begin.system.algebraics else ("cvodes",)


def _fastest_rate(begin: Begin, driven: DrivenInputs, grid: np.ndarray) -> float:
    """Return the largest eigenvalue of the state equations at the start [1/s]; infinite for a large system."""
    made, s = begin.machine, begin.between
    n_x = s.x.numel()
    if n_x > 200:
        return np.inf
    ode, symbols, modes = s.ode, ca.SX(0, 1), np.zeros(0)
    if made is not None:
        (ode,) = _replaced([s.ode], [(s.frictions.force, made.force)])
        symbols, modes = made.memory.modes, made.memory.split(begin.memory)["modes"]
    slopes = ca.Function("slopes", [s.time, s.x, s.z, s.u, s.p, symbols], [ca.jacobian(ode, s.x)])
    u = begin.inputs(inputs_at(driven, grid)[:, 0])
    values = np.asarray(slopes(grid[0], begin.x, begin.z, u, begin.p, modes))
    return float(np.abs(np.linalg.eigvals(values)).max(initial=0.0)) if np.all(np.isfinite(values)) else np.inf


def _inputs(s: System, driven: DrivenInputs, grid: np.ndarray) -> tuple[ca.SX, ca.SX, np.ndarray]:
    """Return the inputs as expressions, the symbols that change between intervals, and their values over these.

    What is constant stands as a number: an integrator stops wherever one of the symbols may change.
    """
    left, slope = driven.left, driven.slope
    values = ca.SX(ca.DM(left[:, 0])) if left.shape[0] else ca.SX(0, 1)
    sloping = np.flatnonzero(np.any(slope != 0, axis=1))
    changing = [r for r in range(left.shape[0]) if r not in driven.expressions and np.any(left[r] != left[r, 0])]
    rows = sorted({*changing, *sloping.tolist()})
    starts, slopes = ca.SX.sym("left", len(rows)), ca.SX.sym("slope", sloping.size)
    begin = ca.SX.sym("begin", 1 if sloping.size else 0)
    for k, row in enumerate(rows):
        values[row] = starts[k]
    for k, row in enumerate(sloping.tolist()):
        values[row] += slopes[k] * (s.time - begin)
    for row, expression in driven.expressions.items():
        values[row] = ca.SX(expression(s.time))
    stacked = np.vstack([left[rows], slope[sloping], *([grid[:-1]] if sloping.size else [])])
    return values, ca.vertcat(starts, slopes, begin), stacked


def _problem(
    system: System, made: Machine | None, driven: DrivenInputs, grid: np.ndarray
) -> tuple[dict[str, ca.SX], ca.Function | None, np.ndarray]:
    """Return the problem for `casadi.integrator`, what happens at events, and inputs over the intervals."""
    s = system
    values, u, stacked = _inputs(s, driven, grid)
    if made is None:
        ode, alg = _replaced([s.ode, s.alg], [(s.u, values)])
        return {"x": s.x, "z": s.z, "p": s.p, "u": u, "t": s.time, "ode": ode, "alg": alg}, None, stacked
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
    return problem, _transition(s, made, u, values), stacked


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
